"""Reading LAS, LAZ and COPC into metres."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection as Fields
from numpy.typing import NDArray

from ...interface.parameters import InputParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.messages import shown
from ..core.progress import Progress
from ..crs.working_frame import WorkingFrame, plausibility, working_frame
from .cloud import PointCloud
from .declared_crs import declared_crs
from .extent import CheckedRecords
from .header import CloudHeader, preflight
from .plant_cover import ERROR, HEIGHT
from .records import PLACES, coordinates, extra_dimensions, read_records

_STANDARD = ("classification", "user_data", "point_source_id", "intensity")


def open_cloud(
    path: Path | str, inputs: InputParameters | None = None, progress: Progress | None = None
) -> tuple[CloudHeader, WorkingFrame]:
    """Header and metre frame of a cloud, without reading its points; warnings and notes go to ``progress``.

    Raises:
        InputError: see ``preflight`` and ``working_frame``.
    """
    header = preflight(path)
    declared, warnings = declared_crs(header)
    if declared is None and warnings and not (inputs and inputs.crs):
        raise InputError(f"{warnings[-1].removesuffix('.')}; give a projected one with --crs EPSG:n.")
    frame = working_frame(declared, inputs or InputParameters(), path)
    notes = (*header.warnings, *warnings, *frame.notes)
    if header.bounds_trusted:
        middle = (np.array(header.bounds_low) + np.array(header.bounds_high)) / 2 * frame.horizontal_factor
        notes += tuple(plausibility(frame, *middle[:2].tolist()))
    if progress is not None:
        for sentence in notes:
            progress.warning(sentence)
    return header, replace(frame, notes=notes)


def read_cloud(
    path: Path | str,
    inputs: InputParameters | None = None,
    *,
    colours: bool = False,
    classification: bool = True,
    progress: Progress | None = None,
) -> PointCloud:
    """Read a whole cloud into metres, with what it records of plants over its ground.

    Args:
        colours: also read colours and intensity.
        classification: also read the classes.

    Raises:
        InputError: see ``preflight`` and ``working_frame``; damaged points.
    """
    progress = progress or Progress()
    header, frame = open_cloud(path, inputs, progress)
    count = header.count
    try:
        xyz = np.empty((count, 3))
        rgb16 = np.empty((count, 3), np.uint16) if colours and header.colours else None
        intensity = np.empty(count, np.uint16) if colours else None
        labels = np.empty(count, np.uint8) if classification else None
        plants = [d for d in extra_dimensions(header) if d.name in (ERROR, HEIGHT) and d.dtype.kind in "uif"]
        over_ground = {d.name: np.empty(count, np.float32) for d in plants}
        wanted = PLACES
        wanted |= Fields.INTENSITY | Fields.RGB if colours else PLACES
        wanted |= Fields.CLASSIFICATION if classification else PLACES
        wanted |= Fields.ALL_EXTRA_BYTES if plants else PLACES
        done = 0
        checked = CheckedRecords(header, wanted)
        for records in checked:
            part = slice(done, done + len(records))
            xyz[part] = coordinates(records, header, frame.factors)
            if rgb16 is not None:
                for band, field in enumerate(("red", "green", "blue")):
                    rgb16[part, band] = records[field]
            if intensity is not None:
                intensity[part] = records["intensity"]
            if labels is not None:
                labels[part] = records["classification"]
            for dimension in plants:
                over_ground[dimension.name][part] = dimension.values(records)
            done += len(records)
            progress.update(done / count)
    except MemoryError as error:
        raise InputError(
            f"{shown(path)} holds {count} points, more than the memory takes; clip it to the area of interest first."
        ) from error
    warnings = checked.extent(frame).warnings
    for sentence in warnings:
        progress.warning(sentence)
    return PointCloud(
        xyz=xyz,
        crs=frame.crs,
        path=Path(path),
        rgb=None if rgb16 is None else eight_bits(rgb16),
        intensity=intensity,
        classification=labels,
        notes=(*frame.notes, *warnings),
        plant_error=over_ground.get(ERROR),
        plant_height=over_ground.get(HEIGHT),
    )


def sample_cloud(path: Path | str, inputs: InputParameters | None = None, stretches: int = 12) -> Float:
    """Coordinates (n, 3) of some stretches of a cloud's points, evenly over the file, metres: for a first look.

    A file of any size takes about a second. What is wrong with the rest of it is not seen.

    Raises:
        InputError: see ``preflight`` and ``working_frame``; damaged points.
    """
    header, frame = open_cloud(path, inputs)
    groups = read_records(header, selection=PLACES, stretches=stretches)
    return np.concatenate([coordinates(records, header, frame.factors) for records in groups])


def read_dimension(path: Path | str, name: str) -> NDArray[np.generic]:
    """The values of the dimension ``name`` of all points, in the file's order; case does not matter unless two differ
    by it.

    Raises:
        InputError: see ``preflight`` and ``read_records``; there is no such dimension, or it holds no numbers.
    """
    header = preflight(path)
    extra = {d.name: d for d in extra_dimensions(header) if d.descriptor}
    names = (*extra, *_STANDARD)
    found = [n for n in names if n == name] or [n for n in names if n.lower() == name.lower()]
    if not found:
        raise InputError(f"{shown(path)} has no dimension {name}; give one of {', '.join(names)}.")
    chosen = extra.get(found[0])
    if chosen is None:
        return np.concatenate([np.array(records[found[0]]) for records in read_records(header)])
    if chosen.dtype.kind not in "uif":
        raise InputError(f"The dimension {chosen.name} of {shown(path)} holds no single numbers; give another one.")
    return np.concatenate([chosen.values(records).copy() for records in read_records(header)])


def read_return_numbers(path: Path | str) -> NDArray[np.uint8]:
    """Which return of its pulse each point is (n,), in the file's order; 1 is the first, 0 where a file does not say.

    Raises:
        InputError: see ``preflight`` and ``read_records``.
    """
    groups = read_records(preflight(path), selection=PLACES)
    return np.concatenate([np.array(records["return_number"], dtype=np.uint8) for records in groups])


def eight_bits(rgb: NDArray[np.uint16], largest: int | None = None) -> NDArray[np.uint8]:
    """Colours of 16 bits in 8; values that never exceed 255 are of 8 bits already, as many writers leave them.

    Args:
        largest: value of the cloud, where these are only some of its colours.
    """
    if rgb.size and (int(rgb.max()) if largest is None else largest) > 255:
        return (rgb >> 8).astype(np.uint8)
    return rgb.astype(np.uint8)
