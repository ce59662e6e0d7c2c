"""Writing clouds: new ones from arrays, and copies of a file with moved points, a selection or more dimensions."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import lazrs
import numpy as np
from laspy import PackedPointRecord
from laspy.point.dims import DimensionInfo, DimensionKind
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import CRSError

from ...interface.parameters import InputParameters
from ..core.arrays import Bool, Float
from ..core.errors import EngineError, InputError
from ..core.messages import one_line, shown
from ..core.staged_outputs import atomic_output
from ..core.version import VERSION
from ..crs.working_frame import WorkingFrame
from ..geometry.columns import greatest, least
from .cloud import PointCloud
from .header import EXTRA_DESCRIPTION_BYTES, MAX_EXTRA_DIMENSIONS, CloudHeader, EmptyCloud, Vector, preflight
from .reading import open_cloud
from .records import ExtraDimension, extra_dimensions, new_dimension, read_records, record_dtype

_DEFAULT_SCALE = 0.001
_GROUP_POINTS = 1_000_000
_MAX_INTEGER = 2**31 - 1
_CREATION_OFFSET_BYTES = 90
"""Place of the day and year of creation in a header; laspy always writes a day, where a new file is to have none."""
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
    labels = cloud.classification if classification is None else np.asarray(classification)
    new = _checked(path, count, dimensions, rgb=cloud.rgb, intensity=cloud.intensity, classification=labels)
    if labels is not None and count and not 0 <= int(labels.min()) <= int(labels.max()) <= 255:
        raise EngineError("classes are not all from 0 to 255")
    scales, offsets = scales_and_offsets(path, cloud.xyz, np.full(3, _DEFAULT_SCALE))
    layout = Layout(6 if cloud.rgb is None else 7, tuple(new), scales, offsets, cloud.crs)
    with laz_writer(path, layout, count) as write:
        for start in range(0, count, _GROUP_POINTS):
            part = slice(start, min(start + _GROUP_POINTS, count))
            records = np.zeros(part.stop - start, layout.dtype)
            set_coordinates(records, cloud.xyz[part], scales, offsets)
            records["bit_fields"] = 0x11  # return 1 of 1
            if labels is not None:
                records["classification"] = labels[part]
            if cloud.intensity is not None:
                records["intensity"] = cloud.intensity[part]
            if cloud.rgb is not None:
                for band, field in enumerate(("red", "green", "blue")):
                    records[field] = cloud.rgb[part, band].astype(np.uint16) * 257
            for dimension, values in new.items():
                records[dimension.field] = values[part]
            write(records)


@dataclass(frozen=True)
class Copy:
    """A file that is to hold points of another, changed as asked.

    Attributes:
        keep: (n,) of the source's points: which to write; all by default.
        xyz: (m, 3) new coordinates in metres of the points that are written.
        dimensions: (m,) extra dimensions by name; one that the source has already is replaced.
        classification: (m,) new classes.
    """

    path: Path
    keep: Bool | None = None
    xyz: Float | None = None
    dimensions: Arrays | None = None
    classification: NDArray[np.integer] | None = None


def copy_with(
    source: Path,
    output: Path,
    inputs: InputParameters | None = None,
    *,
    keep: Bool | None = None,
    xyz: Float | None = None,
    dimensions: Arrays | None = None,
    classification: NDArray[np.integer] | None = None,
) -> None:
    """Write the one ``Copy`` of a cloud that these make; see ``copies``."""
    copies(source, [Copy(output, keep, xyz, dimensions, classification)], inputs)


def copies(
    source: Path, wanted: Sequence[Copy], inputs: InputParameters | None = None, *, flags_in_class: bool = False
) -> None:
    """Copy a cloud into one or more files with every dimension it has, in metres; it is read once.

    Args:
        wanted: written as LAZ, or as LAS where the name ends in .las.
        inputs: how the source is read; without feet, selection and new coordinates its integers are kept.
        flags_in_class: the classes of this source of point format 6 to 10 are bytes of an older format, whose upper
            three bits are flags; they are put where they belong.

    Raises:
        EngineError: arrays that do not fit the source.
        InputError: as ``read_cloud``; the folder cannot be written; coordinates that 32 bits do not hold.
    """
    header, frame = open_cloud(source, inputs)
    copy_records(header, [_target(header, frame, copy, flags_in_class) for copy in wanted])


def _target(header: CloudHeader, frame: WorkingFrame, copy: Copy, flags_in_class: bool) -> Target:
    xyz, keep, classification = copy.xyz, copy.keep, copy.classification
    if keep is not None and len(keep) != header.count:
        raise EngineError(f"keep has {len(keep)} values for the {header.count} points of {shown(header.path)}")
    count = header.count if keep is None else int(np.count_nonzero(keep))
    new = _checked(copy.path, count, copy.dimensions, xyz=xyz, classification=classification)
    if classification is not None and header.point_format < 6 and count and int(np.max(classification)) > 31:
        raise EngineError(f"classes above 31 do not fit point format {header.point_format}")
    # Another unit is another scale: the integers of an unmoved point stay what they are.
    scales, offsets = (np.array(each) * frame.factors for each in (header.scales, header.offsets))
    if xyz is not None:
        scales, offsets = scales_and_offsets(copy.path, xyz, scales)

    def change(records: PackedPointRecord, part: slice) -> None:
        array = records.array
        if xyz is not None:
            set_coordinates(array, xyz[part], scales, offsets)
        if flags_in_class:
            put_flags_apart(records)
        if classification is not None:
            records["classification"] = np.asarray(classification)[part]
        for dimension, values in new.items():
            array[dimension.field] = values[part]

    return Target(copy.path, frame.crs, scales, offsets, change, tuple(new), keep)


def put_flags_apart(records: PackedPointRecord) -> None:
    """Flags in the upper three bits of the classes, as before point format 6, are put where they belong, in place."""
    array = records.array
    array["classification_flags"] |= array["classification"] >> 5
    array["classification"] &= 0x1F


@dataclass(frozen=True)
class Target:
    """A file that records are copied into, those of ``keep`` (n,) or all.

    ``change`` changes copied records in place; the slice is their place among all that are written. ``new`` are extra
    dimensions, zero until ``change`` sets them; they replace those of the same names. The records' integers stay as
    they are.
    """

    path: Path
    crs: CRS
    scales: Vector | Float
    offsets: Vector | Float
    change: Callable[[PackedPointRecord, slice], None]
    new: Sequence[ExtraDimension] = ()
    keep: Bool | None = None


def copy_records(source: CloudHeader, targets: Sequence[Target]) -> None:
    """Copy a file group by group, in the groups of ``read_records``; it is read once.

    Raises:
        EngineError, InputError: as ``laz_writer`` and ``read_records``.
    """
    with contextlib.ExitStack() as stack:
        takers = [stack.enter_context(_taker(source, target)) for target in targets]
        read = 0
        for group in read_records(source):
            part = slice(read, read + len(group))
            for take in takers:
                take(group, part)
            read = part.stop


@contextlib.contextmanager
def _taker(source: CloudHeader, target: Target) -> Iterator[Callable[[PackedPointRecord, slice], None]]:
    """Takes the source's records, group by group, each with its place among them."""
    kept = [d for d in extra_dimensions(source) if d.name not in [n.name for n in target.new]]
    dimensions = tuple(sorted([*kept, *target.new], key=lambda d: not d.descriptor))
    layout = Layout(source.point_format, dimensions, target.scales, target.offsets, target.crs)
    dtype = layout.dtype
    # what both begin with is copied at once, except what is new in the copy
    alike = _common_start(record_dtype(source.point_format, extra_dimensions(source)), dtype)
    width = min([alike, *(_offset(dtype, d.field) for d in target.new)])
    carried = record_dtype(source.point_format, kept).names or ()
    rest = [name for name in carried if _offset(dtype, name) >= width]
    count = source.count if target.keep is None else int(np.count_nonzero(target.keep))
    written = 0

    def take(group: PackedPointRecord, part: slice) -> None:
        nonlocal written
        chosen = group.array if target.keep is None else np.compress(target.keep[part], group.array)
        records = np.zeros(len(chosen), dtype)
        _as_bytes(records)[:, :width] = _as_bytes(chosen)[:, :width]
        for field in rest:
            records[field] = chosen[field]
        target.change(PackedPointRecord(records, group.point_format), slice(written, written + len(records)))
        written += len(records)
        write(records)

    with laz_writer(target.path, layout, count, source) as write:
        yield take


def _common_start(one: np.dtype[np.void], other: np.dtype[np.void]) -> int:
    """Bytes of the fields that two structures of records without gaps begin with alike."""
    for first, second in zip(one.names or (), other.names or (), strict=False):
        if first != second or one[first] != other[second]:
            return min(_offset(one, first), _offset(other, second))
    return min(one.itemsize, other.itemsize)


def _offset(dtype: np.dtype[np.void], name: str) -> int:
    assert dtype.fields is not None
    return int(dtype.fields[name][1])


def _as_bytes(records: NDArray[np.void]) -> NDArray[np.uint8]:
    """(n, bytes of a record) of contiguous records, without a copy."""
    return records.view(np.uint8).reshape(len(records), records.dtype.itemsize)


@dataclass(frozen=True)
class Layout:
    """What a new file says of its points: their format, extra dimensions, integers and reference system."""

    point_format: int
    dimensions: tuple[ExtraDimension, ...]
    scales: Vector | Float
    offsets: Vector | Float
    crs: CRS

    @property
    def dtype(self) -> np.dtype[np.void]:
        return record_dtype(self.point_format, self.dimensions)


@contextlib.contextmanager
def laz_writer(
    path: Path, layout: Layout, count: int, source: CloudHeader | None = None
) -> Iterator[Callable[[NDArray[np.void]], None]]:
    """Takes ``count`` records of ``layout.dtype`` in groups; writes LAZ, or LAS where the name ends in .las.

    Args:
        source: the file of which this is a copy; its file source, kind of GPS time and day of creation are kept.

    Raises:
        EngineError: what was written does not hold ``count`` points.
        InputError: the folder cannot be written, or is full.
    """
    header = laspy.LasHeader(version="1.4", point_format=layout.point_format)
    header.scales, header.offsets = np.array(layout.scales), np.array(layout.offsets)
    header.system_identifier, header.generating_software = "SlopeWatch", f"SlopeWatch {VERSION}"
    header.global_encoding.wkt = True
    header.global_encoding.gps_time_type = source is None or source.standard_time
    header.file_source_id = source.file_source if source else 0
    header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", wkt_of(layout.crs).encode() + b"\0"))
    described = b"".join(d.descriptor for d in layout.dimensions)
    if len(described) > MAX_EXTRA_DIMENSIONS * EXTRA_DESCRIPTION_BYTES:
        raise InputError(
            f"{shown(source.path if source else path)} has too many extra dimensions to add others; a file takes "
            f"{MAX_EXTRA_DIMENSIONS}, so export it with fewer."
        )
    if described:
        header.vlrs.append(laspy.VLR("LASF_Spec", 4, "", described))
    extra = sum(d.dtype.itemsize for d in layout.dimensions)
    if extra:
        # To laspy they are bytes: it would lose parts of the descriptions and put false ranges into them.
        kind = DimensionKind.UnsignedInteger
        header.point_format.dimensions.append(DimensionInfo("extra", kind, 8 * extra, extra, is_standard=False))
    compress, backend = path.suffix.lower() != ".las", laspy.LazBackend.LazrsParallel
    with atomic_output(path, lambda p: _check(p, count)) as temporary, temporary.open("w+b") as stream:
        writer = laspy.LasWriter(stream, header, compress, laz_backend=backend, closefd=False)
        plain = header.point_format.dtype()  # names of our fields are none of a buffer's
        try:
            yield lambda records: writer.write_points(PackedPointRecord(records.view(plain), header.point_format))
            writer.close()
        except lazrs.LazrsError as error:  # says nothing of a disk that is full, which is what stops it
            raise InputError(
                f"{shown(path)} cannot be written ({one_line(str(error))}); free some space or choose another folder."
            ) from error
        stream.seek(_CREATION_OFFSET_BYTES)
        stream.write(struct.pack("<HH", *(source.created if source else (0, 0))))


def wkt_of(crs: CRS) -> str:
    """WKT 1, which every LAS reader knows; WKT 2 where that cannot say it."""
    with contextlib.suppress(CRSError):
        text = crs.to_wkt("WKT1_GDAL")
        if text and CRS.from_wkt(text).equals(crs, ignore_axis_order=True):
            return str(text)
    return str(crs.to_wkt("WKT2_2019"))


def _check(path: Path, count: int) -> None:
    """Reopen what was written: a sound header, sound chunks, all points."""
    held = preflight(path).count
    if held != count:
        raise EngineError(f"{path.name} was written with {held} points instead of {count}")


def _checked(
    path: Path, count: int, dimensions: Arrays | None, **arrays: NDArray[np.generic] | None
) -> dict[ExtraDimension, NDArray[np.generic]]:
    """The new dimensions with their values; refuses no points, and arrays that do not fit them."""
    if count == 0:
        raise EmptyCloud(f"{shown(path)} would hold no points; choose a larger area or other parameters.")
    for what, array in arrays.items():
        if array is not None and len(array) != count:
            raise EngineError(f"{what} has {len(array)} values for {count} points")
    values = {name: np.asarray(array) for name, array in (dimensions or {}).items()}
    for name, array in values.items():
        if array.shape != (count,):
            raise EngineError(f"the dimension {name} has the shape {array.shape} for {count} points")
    return {new_dimension(name, array.dtype): array for name, array in values.items()}


def scales_and_offsets(path: Path, xyz: Float, wanted: Float) -> tuple[Float, Float]:
    """Scales at most 1 mm and offsets near the middle, so that 32 bits hold the coordinates; finer where that fits."""
    low, high = least(xyz), greatest(xyz)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise EngineError("coordinates that are not finite cannot be written")
    offsets = np.round((low + high) / 2000.0) * 1000.0
    reach = np.maximum(high - offsets, offsets - low)
    scales = np.minimum(wanted, _DEFAULT_SCALE)
    scales[reach / scales > _MAX_INTEGER] = _DEFAULT_SCALE
    beyond = np.flatnonzero(reach / scales > _MAX_INTEGER)
    if len(beyond):
        axis = beyond[0]
        raise InputError(
            f"{shown(path)} cannot hold coordinates from {low[axis]:.0f} to {high[axis]:.0f} in {'xyz'[axis]} to "
            "the millimetre; clip the cloud to the area of interest or remove its outliers first."
        )
    return scales, offsets


def set_coordinates(records: NDArray[np.void], xyz: Float, scales: Float, offsets: Float) -> None:
    for axis, field in enumerate("XYZ"):
        records[field] = np.rint((xyz[:, axis] - offsets[axis]) / scales[axis]).astype(np.int32)
