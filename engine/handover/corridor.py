"""The slopes of a finished batch: where the results of each lie, and what becomes of links to them in a hand-over."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ..core.errors import InputError
from ..core.messages import shown
from ..core.part_folders import settle
from ..report.record_shape import inside
from .held import Held, HeldLayer, check_files, find_record

SLOPES = "slopes"
"""Layer of a corridor with a row a slope, and the folder of their parts in a hand-over."""
_DONE = "done"


@dataclass(frozen=True)
class SlopeRun:
    """A slope that is done.

    ``name`` is that in the manifest, ``folder`` that of its part (safe on every system), ``record`` its run record,
    and ``report`` its report's path as the corridor's page and layer name it.
    """

    name: str
    folder: str
    record: Path
    report: str


def slopes_of(held: Held) -> tuple[SlopeRun, ...]:
    """The slopes whose results a batch's layer of slopes names; none where ``held`` is no batch's.

    Raises:
        InputError: the results of one are gone, or a file that its record names is.
    """
    found = []
    for name, report in _reports(held).items():
        folder = (held.folder / report).parent
        if not folder.is_dir():
            raise InputError(f"{shown(folder)} is missing, though the corridor names it; run the batch again.")
        found.append(SlopeRun(name, folder.parent.name, find_record(folder), report))
    for slope in found:
        check_files(slope.record)
    return tuple(found)


def _reports(held: Held) -> dict[str, str]:
    """The report of each slope that is done, as the layer names it."""
    layer = next((layer for layer in held.layers if layer.name == SLOPES), None)
    if held.record["command"] != "batch" or layer is None or not {"slope", "state", "report"} <= set(layer.frame):
        return {}
    rows = layer.frame[layer.frame["state"] == _DONE]
    named = zip(rows["slope"].astype(str), rows["report"].astype(object), strict=True)
    return {name: path for name, path in named if isinstance(path, str) and path and inside(held.folder, path)}


def records_of_slopes(held: Held) -> dict[str, Path]:
    """The run record of each slope of a batch that has one, by the slope's name; nothing more is looked at."""
    records = {name: (held.folder / path).parent / "run.json" for name, path in _reports(held).items()}
    for path in records.values():
        settle(path.parent)
    return {name: path for name, path in records.items() if path.is_file()}


def no_reports(held: Held) -> dict[str, str]:
    """For each report of a slope that none of them lies in the hand-over, see ``reports_in_parts``."""
    return dict.fromkeys(_reports(held).values(), "")


def reports_in_parts(slopes: Iterable[SlopeRun]) -> dict[str, str]:
    """Where the reports of slopes lie in a hand-over, by where they lie in the batch."""
    return {slope.report: f"{SLOPES}/{slope.folder}/report/{PurePosixPath(slope.report).name}" for slope in slopes}


def with_reports(held: Held, reports: Mapping[str, str]) -> Held:
    """The corridor whose layer of slopes names the reports where they are in the hand-over."""

    def named(layer: HeldLayer) -> HeldLayer:
        if layer.name != SLOPES or "report" not in layer.frame:
            return layer
        there = [reports.get(path, "") if isinstance(path, str) else "" for path in layer.frame["report"]]
        return replace(layer, frame=layer.frame.assign(report=there))

    return replace(held, layers=tuple(named(layer) for layer in held.layers))
