"""Writing clouds: new ones from arrays, and copies of a file with moved points, a selection or more dimensions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from laspy import PackedPointRecord
from numpy.typing import NDArray
from pyproj import CRS

from ...interface.parameters import InputParameters
from ..core.errors import EngineError, InputError
from ..core.messages import shown
from .cloud import PointCloud
from .header import CloudHeader, EmptyCloud, Vector
from .laz_file import write_laz
from .reading import open_cloud
from .records import ExtraDimension, extra_dimensions, new_dimension, read_records, record_dtype

_SCALE = 0.001
_GROUP = 1_000_000
_LIMIT = 2**31 - 1
Arrays = Mapping[str, NDArray[np.generic]]


def write_cloud(
    path: Path,
    cloud: PointCloud,
    *,
    dimensions: Arrays | None = None,
    classification: NDArray[np.integer] | None = None,
) -> None:
    """Write a cloud as LAZ (LAS 1.4, point format 7 with colours, else 6) with its reference system.

    Args:
        dimensions: extra dimensions by name, each (n,).
        classification: (n,) classes to write instead of the cloud's own.

    Raises:
        EngineError: arrays that do not fit the cloud, or coordinates that are not finite.
        InputError: the folder cannot be written, or the coordinates span more than 32 bits hold.
    """
    count = len(cloud.xyz)
    _refuse_empty(path, count)
    extra, values = _new_dimensions(dimensions, count)
    labels = cloud.classification if classification is None else np.asarray(classification)
    for what, array in (("rgb", cloud.rgb), ("intensity", cloud.intensity), ("classification", labels)):
        if array is not None and len(array) != count:
            raise EngineError(f"{what} has {len(array)} values for {count} points")
    if labels is not None and count and not 0 <= int(labels.min()) <= int(labels.max()) <= 255:
        raise EngineError("classes are not all from 0 to 255")
    scales, offsets = _scales_and_offsets(path, cloud.xyz, (_SCALE,) * 3)
    point_format = 6 if cloud.rgb is None else 7
    dtype = record_dtype(point_format, extra)

    def groups() -> Iterator[NDArray[np.void]]:
        for start in range(0, count, _GROUP):
            part = slice(start, min(start + _GROUP, count))
            records = np.zeros(part.stop - start, dtype)
            _set_coordinates(records, cloud.xyz[part], scales, offsets)
            records["bit_fields"] = 0x11  # return 1 of 1
            if labels is not None:
                records["classification"] = labels[part]
            if cloud.intensity is not None:
                records["intensity"] = cloud.intensity[part]
            if cloud.rgb is not None:
                for band, field in enumerate(("red", "green", "blue")):
                    records[field] = cloud.rgb[part, band].astype(np.uint16) * 257
            for dimension in extra:
                records[dimension.field] = values[dimension.name][part]
            yield records

    write_laz(
        path,
        groups(),
        count,
        point_format=point_format,
        dimensions=extra,
        scales=scales,
        offsets=offsets,
        crs=cloud.crs,
    )


def copy_with(
    source: Path,
    output: Path,
    inputs: InputParameters | None = None,
    *,
    keep: NDArray[np.bool_] | None = None,
    xyz: NDArray[np.float64] | None = None,
    dimensions: Arrays | None = None,
    classification: NDArray[np.integer] | None = None,
    flags_in_class: bool = False,
) -> None:
    """Copy a cloud as LAZ with every dimension it has, in metres, changed as asked.

    Args:
        inputs: how the source is read; without feet, selection and new coordinates its integers are kept.
        keep: (n,) of the source's points: which to write; all by default.
        xyz: (m, 3) new coordinates in metres of the points that are written.
        dimensions: (m,) extra dimensions by name; one that the source has already is replaced.
        classification: (m,) new classes.
        flags_in_class: the classes of this source of point format 6 to 10 are bytes of an older format, whose upper
            three bits are flags; they are put where they belong.

    Raises:
        EngineError: arrays that do not fit the source.
        InputError: as ``read_cloud``; the folder cannot be written; coordinates that 32 bits do not hold.
    """
    header, frame = open_cloud(source, inputs)
    if keep is not None and len(keep) != header.count:
        raise EngineError(f"keep has {len(keep)} values for the {header.count} points of {shown(source)}")
    count = header.count if keep is None else int(np.count_nonzero(keep))
    _refuse_empty(output, count)
    for what, array in (("xyz", xyz), ("classification", classification)):
        if array is not None and len(array) != count:
            raise EngineError(f"{what} has {len(array)} values for {count} points")
    if classification is not None and header.point_format < 6 and count and int(np.max(classification)) > 31:
        raise EngineError(f"classes above 31 do not fit point format {header.point_format}")
    new, values = _new_dimensions(dimensions, count)
    factors = np.array(frame.factors)
    # Another unit is another scale: the integers of an unmoved point stay what they are.
    scales = _vector(np.array(header.scales) * factors)
    offsets = _vector(np.array(header.offsets) * factors)
    if xyz is not None:
        scales, offsets = _scales_and_offsets(output, xyz, scales)

    def change(records: PackedPointRecord, part: slice) -> None:
        array = records.array
        if xyz is not None:
            _set_coordinates(array, xyz[part], scales, offsets)
        if flags_in_class:
            array["classification_flags"] |= array["classification"] >> 5
            array["classification"] &= 0x1F
        if classification is not None:
            records["classification"] = np.asarray(classification)[part]
        for dimension in new:
            array[dimension.field] = values[dimension.name][part]

    copy_records(header, output, frame.crs, change, new=new, keep=keep, scales=scales, offsets=offsets)


def copy_records(
    source: CloudHeader,
    output: Path,
    crs: CRS,
    change: Callable[[PackedPointRecord, slice], None],
    *,
    new: Sequence[ExtraDimension] = (),
    keep: NDArray[np.bool_] | None = None,
    scales: Vector | None = None,
    offsets: Vector | None = None,
) -> None:
    """Copy a file as LAZ group by group, in the groups of ``read_records``.

    Args:
        change: changes copied records in place; the slice is their place among all that are written.
        new: extra dimensions, zero until ``change`` sets them; they replace those of the same names.
        keep: (n,) of the source's points: which to write; all by default.
        scales: of the integers, which stay as they are; the source's by default, as are ``offsets``.

    Raises:
        EngineError, InputError: as ``write_laz`` and ``read_records``.
    """
    kept = [d for d in extra_dimensions(source) if d.name not in [n.name for n in new]]
    dimensions = sorted([*kept, *new], key=lambda d: not d.descriptor)
    dtype = record_dtype(source.point_format, dimensions)
    carried = record_dtype(source.point_format, kept).names or ()

    def groups() -> Iterator[NDArray[np.void]]:
        read = written = 0
        for group in read_records(source):
            chosen = group.array if keep is None else group.array[keep[read : read + len(group)]]
            read += len(group)
            records = np.zeros(len(chosen), dtype)
            for field in carried:
                records[field] = chosen[field]
            change(PackedPointRecord(records, group.point_format), slice(written, written + len(records)))
            written += len(records)
            yield records

    write_laz(
        output,
        groups(),
        source.count if keep is None else int(np.count_nonzero(keep)),
        point_format=source.point_format,
        dimensions=dimensions,
        scales=scales or source.scales,
        offsets=offsets or source.offsets,
        crs=crs,
        source=source,
    )


def _new_dimensions(
    dimensions: Arrays | None, count: int
) -> tuple[list[ExtraDimension], dict[str, NDArray[np.generic]]]:
    values = {name: np.asarray(array) for name, array in (dimensions or {}).items()}
    for name, array in values.items():
        if array.shape != (count,):
            raise EngineError(f"the dimension {name} has the shape {array.shape} for {count} points")
    return [new_dimension(name, array.dtype) for name, array in values.items()], values


def _scales_and_offsets(path: Path, xyz: NDArray[np.float64], wanted: Vector) -> tuple[Vector, Vector]:
    """Scales at most 1 mm and offsets near the middle, so that 32 bits hold the coordinates; finer where that fits."""
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise EngineError("coordinates that are not finite cannot be written")
    scales, offsets = [], []
    for axis in range(3):
        offset = float(np.round((low[axis] + high[axis]) / 2000.0) * 1000.0)
        reach = max(high[axis] - offset, offset - low[axis])
        scale = min(wanted[axis], _SCALE)
        if reach / scale > _LIMIT:
            scale = _SCALE
        if reach / scale > _LIMIT:
            raise InputError(
                f"{shown(path)} cannot hold coordinates from {low[axis]:.0f} to {high[axis]:.0f} in {'xyz'[axis]} to "
                "the millimetre; clip the cloud to the area of interest or remove its outliers first."
            )
        scales.append(scale)
        offsets.append(offset)
    return _vector(scales), _vector(offsets)


def _set_coordinates(records: NDArray[np.void], xyz: NDArray[np.float64], scales: Vector, offsets: Vector) -> None:
    for axis, field in enumerate("XYZ"):
        records[field] = np.rint((xyz[:, axis] - offsets[axis]) / scales[axis]).astype(np.int32)


def _vector(values: NDArray[np.float64] | list[float]) -> Vector:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _refuse_empty(path: Path, count: int) -> None:
    if count == 0:
        raise EmptyCloud(f"{shown(path)} would hold no points; choose a larger area or other parameters.")
