"""Corrections by hand of one slope: read, checked against its surveys, and put into the run record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import shapely

from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.epochs.epoch import Epoch
from ..engine.pointcloud.reading import open_cloud
from ..engine.vector.area import read_roi
from ..engine.vector.corrections import Corrections, OutsideError, read_corrections
from ..interface.corrections import ACTION, GROUND
from ..interface.parameters import InputParameters


def corrections_of(
    path: Path | None, epochs: Sequence[Epoch], roi: Path | None, inputs: InputParameters, progress: Progress
) -> Corrections | None:
    """The corrections that lie on the slope of some surveys; None without a file.

    Args:
        roi: vector file whose polygons bound the slope; else it is the extent of the first survey.

    Raises:
        InputError: the file cannot be used, none of it lies on the slope, or a correction is of no survey.
    """
    if path is None:
        return None
    header, frame = open_cloud(epochs[0].path, inputs)
    unit = frame.horizontal_factor
    found, notes = read_corrections(path, frame.crs, unit=unit)
    if roi is not None:
        found, outside = found.within(read_roi(roi, frame.crs, unit=unit).geometry)
        notes = (*notes, outside)
    elif header.bounds_trusted:
        low, high = ([v * unit for v in corner[:2]] for corner in (header.bounds_low, header.bounds_high))
        found, outside = found.within(shapely.box(*low, *high))
        notes = (*notes, outside)
    found.refuse_other_days([epoch.date for epoch in epochs])
    for note in filter(None, notes):
        progress.warning(note)
    return found


def refuse_forced_ground(corrections: Corrections, ground: str) -> None:
    """Raise InputError if ground is forced where all points of a series are the ground already."""
    if ground == "as_is" and any(area.action == GROUND for area in corrections.areas):
        raise InputError(
            f"{shown(corrections.path)} has areas with the {ACTION} {GROUND}, but all points of the surveys are taken "
            "as the ground; remove these areas, or set ground to extract."
        )


def lie_on(path: Path, epochs: Sequence[Epoch], roi: Path | None, inputs: InputParameters) -> bool:
    """Whether some corrections of a file lie on the slope of these surveys.

    Raises:
        InputError: they cannot be used.
    """
    try:
        corrections_of(path, epochs, roi, inputs, Progress())
    except OutsideError:
        return False
    return True
