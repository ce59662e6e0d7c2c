"""What the report relies on in a run record; older records lack some of it, and none of it may be of another kind."""

from __future__ import annotations

import itertools
from pathlib import Path, PurePosixPath
from typing import Any

from ..core.json_shapes import (
    MisfitError,
    anything,
    day,
    fields,
    maybe,
    moment,
    number,
    rows,
    table,
    text,
)

_NUMBER, _SHARE_OR_MORE, _POSITIVE = number(), number(0.0), number(0.0, above=True)
_COUNTS = rows(_SHARE_OR_MORE, most=100_000)
_TEXTS = rows(text())
_ROWS = rows(fields({}))
_SENTENCES = fields({}, {"sentence": text(), "name": text(), "sha256": text(), "version": text(), "chosen": text()})

_HEIGHTS = fields(
    {
        "from_m": _NUMBER, "bin_m": _POSITIVE, "returns": rows(_SHARE_OR_MORE, 1, 100_000), "ground": _COUNTS,
        "below": _SHARE_OR_MORE, "above": _SHARE_OR_MORE,
    }
)  # fmt: skip
_COVER = fields({"heights": _HEIGHTS, "classes": rows(fields({"name": text()}))})
_STRIPS = fields(
    {"strips": rows(_NUMBER, 2, 100), "disagreement_before_m": _SHARE_OR_MORE, "disagreement_after_m": _SHARE_OR_MORE},
    {"correction": text()},
)
_SURVEY = fields({}, {"classified": maybe(text()), "cover": maybe(_COVER), "strips": maybe(_STRIPS)})
_STAGE = fields({}, {"stage": text(), "epochs": table(_SURVEY)})

_CORRECTION = fields({"action": text(), "reason": text(), "epoch": text(), "area_m2": _SHARE_OR_MORE})

RECORD = fields(
    {
        "software": text(),
        "command": text(),
        "started": moment,
        "parameters": table(table(anything)),
        "inputs": rows(fields({"role": text()}, {"path": text(), "sha256": text()})),
        "metrics": fields(
            {}, {"zone_count": _SHARE_OR_MORE, "epoch_count": _SHARE_OR_MORE, "reference_plane_dip": maybe(_NUMBER)}
        ),
        "warnings": _TEXTS,
        "outputs": table(text()),
        "versions": table(text()),
    },
    {
        "run_id": text(),
        "language": text(),
        "pdal": _SENTENCES,
        "model": maybe(_SENTENCES),
        "reference_system": maybe(fields({}, {"name": text()})),
        "stages": rows(_STAGE),
        "displacement_left_out": text(),
        "corrections": fields({"areas": rows(_CORRECTION)}),
    },
)
"""Of every command that has a report."""

_PROFILE = fields({"name": text(), "length_m": _POSITIVE, "dz_min_m": maybe(_NUMBER), "dz_max_m": maybe(_NUMBER)})
_OBJECT = fields(
    {
        **dict.fromkeys(("object_id", "kind", "change", "zone_id"), text()),
        **dict.fromkeys(("height_m", "length_m", "width_m", "volume_m3", "n_points", "confidence"), _SHARE_OR_MORE),
        **dict.fromkeys(("deposit", "x", "y"), _NUMBER),
    },
    dict.fromkeys(("volume_low_m3", "volume_high_m3"), _SHARE_OR_MORE),
)
_CLASSES = rows(fields({"class": text(), "vol_net_m3": _NUMBER}), most=2000)
_VOLUME = fields({"group": text(), "quantity": text(), "unit": text()})
_COREGISTRATION = fields(
    {"from": text(), "to": text(), "plan_shift": text(), "sentences": rows(text(), 2)},
    {"attributes": rows(fields({"attribute": text()}))},
)
_MOVED = fields({"motion_m": rows(_NUMBER, 3, 3), "error_m": rows(_SHARE_OR_MORE, 3, 3)}, {"share": _SHARE_OR_MORE})
_DISPLACEMENT = fields(
    {
        "windows": _SHARE_OR_MORE,
        "zone_count": _SHARE_OR_MORE,
        "significant_vectors": _SHARE_OR_MORE,
        "zones": rows(fields({"zone_id": text(), "direction": text(), "p_map": _SHARE_OR_MORE})),
        "refused": rows(fields({"reason": text(), "share": _SHARE_OR_MORE})),
        "taken_off_m": rows(_NUMBER, 3, 3),
        "notes": _TEXTS,
    },
    {
        "common": maybe(_MOVED),
        "wide_window_m": maybe(_POSITIVE),
        "chance_vectors": _SHARE_OR_MORE,
        "chance_vectors_most": _SHARE_OR_MORE,
    },
)
_CHANGE = fields(
    {
        "epochs": rows(fields({"name": text()}, {"date": maybe(day)}), 2, 2),
        "grid": fields({"cell_m": _POSITIVE}),
        "colour_limit_m": _POSITIVE,
        "level": fields(
            {"p05_m": _SHARE_OR_MORE, "median_m": _SHARE_OR_MORE, "p95_m": _SHARE_OR_MORE}, {"by_slope": _ROWS}
        ),
        "distribution": fields(
            {"bin_m": _POSITIVE, "reach_m": _POSITIVE, "compared": _COUNTS, "beyond": _COUNTS, "stable": _COUNTS}
        ),
        "stable_ground": maybe(fields({"cells": _SHARE_OR_MORE, "median_m": _NUMBER, "nmad_m": _SHARE_OR_MORE})),
    },
    {
        "cell": maybe(_SENTENCES),
        "cell_sizes": maybe(_ROWS),
        "density": _ROWS,
        "season": maybe(_SENTENCES),
        "seen": maybe(table(_SHARE_OR_MORE)),
        "uniform_dz_m": maybe(_NUMBER),
        "zones": maybe(rows(fields({"zone_id": text()}, {"kind": text(), "severity": text()}))),
        "objects": rows(_OBJECT),
        "profiles": maybe(rows(_PROFILE)),
        "volumes": maybe(fields({"rows": rows(_VOLUME), "error_model": fields({"model": text()})})),
        "coregistration": maybe(rows(_COREGISTRATION)),
        "classes": maybe(_CLASSES),
        "pairs": maybe(rows(fields({"from": text(), "to": text()}))),
        "one_grid": maybe(_TEXTS),
        "registration": maybe(fields({}, {"unobservable": maybe(_TEXTS)})),
        "level_of_detection": maybe(fields({}, {"terms": maybe(_ROWS), "slope_classes": maybe(_ROWS)})),
    },
)
_FACE = fields(
    {
        "colour_limit_m": _POSITIVE,
        "face": fields({"dip_deg": _NUMBER, "azimuth_deg": _NUMBER, "cell_m": _POSITIVE}),
        "zones": rows(fields({"zone_id": text(), "kind": text()})),
        "volumes": fields({"rows": rows(_VOLUME), "error_model": fields({"model": text()})}),
    },
    {"level_of_detection": fields({}, {"slope_classes": maybe(_ROWS)})},
)
_COVERAGE = (
    "compared_share", "compared_m2", "only_first_m2", "only_this_m2", "too_few_points_m2", "points_m2",
    "first_points_m2", "error_median_m", "vegetation_m2",
)  # fmt: skip
_COVERED = fields({"epoch": day}, dict.fromkeys(_COVERAGE, _SHARE_OR_MORE))
_COURSE_NUMBERS = ("dz_mean_m", "dz_err_m", "vol_net_m3", "vol_err_m3", "motion_m", "motion_err_m", "alert_level")
_COURSE = fields(
    {"epoch": day}, {**dict.fromkeys(_COURSE_NUMBERS, _NUMBER), "alert_state": text(), "alert_reason": text()}
)
_SERIES = fields(
    {"zones": maybe(rows(fields({"zone_id": text()}, {"kind": text()})))},
    {
        "classes": maybe(_CLASSES),
        "course": maybe(table(rows(_COURSE))),
        "coverage": maybe(rows(_COVERED)),
        "limits": maybe(_TEXTS),
        "dates": rows(day, 2, 10_000),
        "motion": maybe(fields({}, {"measured_share": _SHARE_OR_MORE, "smallest_motion_median_m": maybe(_NUMBER)})),
    },
)


def run_record(value: Any, place: str = "") -> None:
    """The shape of a run record from which a report can be made, whatever the command.

    Raises:
        MisfitError: it is none, or two of its parts contradict one another.
    """
    RECORD(value, place)
    if value.get("displacement") and value["command"] != "series":
        _DISPLACEMENT(value["displacement"], "displacement")
    if value.get("epochs"):
        _CHANGE(value, place)
        _change_fits(value)
    elif value["command"] == "m3c2":
        _FACE(value, place)
    elif value["command"] == "series":
        _SERIES(value, place)
        _series_fits(value)
    for number_of_stage, stage in enumerate(value.get("stages", ())):
        for name, survey in stage.get("epochs", {}).items():
            heights = (survey.get("cover") or {}).get("heights")
            if heights and len(heights["ground"]) != len(heights["returns"]):
                raise MisfitError(f"stages[{number_of_stage}].epochs.{name!a}.cover.heights", "of one length")


def _change_fits(record: dict[str, Any]) -> None:
    shown = record["distribution"]
    lengths = {len(shown[name]) for name in ("compared", "beyond", "stable")}
    if len(lengths) > 1 or lengths == {0} or lengths.pop() % 2:
        raise MisfitError("distribution", "bins of one even number")
    for index, profile in enumerate(record.get("profiles") or ()):
        if (profile["dz_min_m"] is None) != (profile["dz_max_m"] is None):
            raise MisfitError(f"profiles[{index}].dz_max_m", "known where dz_min_m is")


def _series_fits(record: dict[str, Any]) -> None:
    dates, course = record.get("dates") or [], record.get("course") or {}
    if course and not dates:
        raise MisfitError("dates", "there, though course is")
    if any(before >= after for before, after in itertools.pairwise(dates)):
        raise MisfitError("dates", "in order")
    for zone in record["zones"] or () if course else ():
        if zone["zone_id"] not in course:
            raise MisfitError("course", f"there for the zone {zone['zone_id'][:40]!a}")


def inside(folder: Path, name: str) -> Path | None:
    """The file that a record names in its folder; None for a name that leads elsewhere.

    A record is text from a file: what it names is read only where the run itself wrote.
    """
    parts = PurePosixPath(name.replace("\\", "/")).parts
    if not parts or "\0" in name or ".." in parts or Path(name).is_absolute() or parts[0] == "/":
        return None
    return folder / name
