"""What a cloud file holds, for people: header, reference system, extent, density, returns, classes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...interface.parameters import InputParameters
from ..core.errors import InputError
from ..core.progress import Progress
from ..crs.working_frame import WorkingFrame, plausibility, working_frame
from .coordinate_step import coordinate_step
from .declared_crs import declared_crs
from .extent import CheckedRecords, square_metres
from .header import preflight
from .records import coordinates


def describe_cloud(
    path: Path | str, inputs: InputParameters | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """Facts about a cloud, ready for JSON. Lengths are metres where the reference system allows, see ``units``.

    A cloud without a usable reference system is described too; why it is refused elsewhere is among the warnings.

    Raises:
        InputError: see ``preflight``; damaged points.
    """
    progress = progress or Progress()
    header = preflight(path)
    declared, warnings = declared_crs(header)
    sentences = [*header.warnings, *warnings]
    frame: WorkingFrame | None = None
    try:
        frame = working_frame(declared, inputs or InputParameters(), path)
        sentences += frame.notes
    except InputError as error:
        sentences.append(str(error))
    checked = CheckedRecords(header)
    by_return, by_class, cells = np.zeros(16, np.int64), np.zeros(256, np.int64), np.empty(0, np.int64)
    coloured = False
    for records in checked:
        by_return += np.bincount(records["return_number"], minlength=16)
        by_class += np.bincount(records["classification"], minlength=256)
        coloured = coloured or (header.colours and any(records[band].any() for band in ("red", "green", "blue")))
        if frame is not None:
            cells = np.union1d(cells, square_metres(coordinates(records, header, frame.factors)))
        progress.update(checked.done / header.count, "reading")
    extent = checked.extent(frame)
    sentences += extent.warnings
    if frame is not None:
        middle = (extent.low[0] + extent.high[0]) / 2, (extent.low[1] + extent.high[1]) / 2
        sentences += plausibility(frame, *middle)
    return {
        "path": str(path),
        "bytes": header.file_size,
        "las_version": header.version,
        "point_format": header.point_format,
        "compressed": header.compressed,
        "copc": header.copc,
        "software": header.software,
        "points": header.count,
        "reference_system": _crs_facts(declared, frame),
        "units": "m" if frame is not None else "as in the file",
        "scale": list(header.scales),
        "coordinate_step": None if frame is None else list(coordinate_step(Path(path), inputs)),
        "x": [extent.low[0], extent.high[0]],
        "y": [extent.low[1], extent.high[1]],
        "z": [extent.low[2], extent.high[2]],
        "area": float(len(cells)) if frame is not None else None,
        "density": header.count / len(cells) if frame is not None else None,
        "points_by_return": {str(n): int(by_return[n]) for n in np.flatnonzero(by_return)},
        "points_by_class": {str(n): int(by_class[n]) for n in np.flatnonzero(by_class)},
        "colours": coloured,
        "warnings": sentences,
    }


def _crs_facts(declared: Any, frame: WorkingFrame | None) -> dict[str, Any]:
    facts: dict[str, Any] = {"declared": None if declared is None else declared.name, "working": None}
    if frame is not None:
        facts["working"] = frame.crs.name
        facts["epsg"] = frame.crs.to_epsg()
        facts["metres_per_unit"] = list(frame.factors)
        facts["has_heights"] = frame.crs.is_compound or len(frame.crs.axis_info) > 2
    return facts
