"""What a further survey changes in the figures that an earlier run of the series stated, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..engine.core.progress import Progress
from ..engine.series.comparisons import GriddedEpoch
from .series_store import FOLDER

_PRINTED = {"dz_mean_m": 0.001, "dz_err_m": 0.001, "vol_net_m3": 0.01, "vol_err_m3": 0.01, "motion_m": 0.001}
"""Figures of a zone after a survey, and the last digit of each that the report prints."""


def say_changed_figures(facts: dict[str, Any], earlier: dict[str, Any] | None, progress: Progress) -> None:
    """Name the zones whose figures of earlier surveys are no longer those of the earlier run.

    Args:
        facts: of this run: its ``zones`` and their ``course``.
        earlier: record of the run before; None: there is none.
    """
    if earlier is None:
        return
    zones = {zone["zone_id"]: zone for zone in facts["zones"]}
    of_area, of_figures, of_level, gone = [], [], [], []
    for before in earlier.get("zones") or ():
        name = str(before.get("zone_id"))
        rows, now = ((record.get("course") or {}).get(name, []) for record in (earlier, facts))
        after = {row["epoch"]: row for row in now}
        pairs = [(row, after.get(row["epoch"], {})) for row in rows]
        if name not in zones:
            gone.append(name)
        elif before.get("area_m2") not in (None, zones[name]["area_m2"]):
            of_area.append(name)
        elif any(_differ(*pair) for pair in pairs):
            of_figures.append(name)
        if name in zones and any(a.get("alert_level") not in (None, b.get("alert_level")) for a, b in pairs):
            of_level.append(name)
    if of_area:
        progress.warning(
            f"The area of {', '.join(of_area)} is not that of the earlier run; the figures of all surveys are now of "
            "the new area."
        )
    if of_figures:
        progress.warning(f"Figures of earlier surveys of {', '.join(of_figures)} are not those of the earlier run.")
    if of_level:
        progress.warning(
            f"Alert levels after earlier surveys of {', '.join(of_level)} are not those of the earlier run."
        )
    if gone:
        progress.warning(f"The earlier run had the zones {', '.join(gone)}, which are no zones of their own any more.")


def _differ(before: dict[str, Any], after: dict[str, Any]) -> bool:
    """Whether a figure differs in a digit that the report prints."""
    return any(
        (name in before) != (name in after) or (name in before and abs(before[name] - after[name]) >= digit)
        for name, digit in _PRINTED.items()
    )


def say_recomputed(gridded: Sequence[GriddedEpoch], earlier: dict[str, Any] | None, progress: Progress) -> None:
    """Name the surveys of the earlier run that were computed again, as they are after an update."""
    roles = {i["role"] for i in (earlier or {}).get("inputs", ())}
    again = [g.epoch.name for g in gridded if g.made and f"epoch {g.epoch.name}" in roles]
    if again:
        progress.warning(
            f"The surveys of {', '.join(again)} were computed again, because what the folder {FOLDER} keeps of them is "
            "missing, damaged, of another version or of another first survey."
        )
