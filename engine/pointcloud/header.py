"""Sanity of a LAS or LAZ header, in plain Python, before any native reader sees the file.

Follows the ASPRS LAS specification 1.4 R15 and, for compressed files, the LASzip record. Reading is bounded: no
length found in the file decides how much is read or allocated.
"""

from __future__ import annotations

import math
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ...interface.input_files import PART
from ..core.errors import InputError
from ..core.input_files import open_input
from ..core.messages import shown
from .laz_chunks import LazLayout, PointBlock, laz_layout

POINT_SIZES = {0: 20, 1: 28, 2: 26, 3: 34, 4: 57, 5: 63, 6: 30, 7: 36, 8: 38, 9: 59, 10: 67}
"""Least bytes of a point record, by point format."""

_HEADER_SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
_VLR_HEADER, _EVLR_HEADER = 54, 60
_MAXIMUM_VLRS = 10_000
_MAXIMUM_EVLRS = 1_000
EXTRA_DESCRIPTION_BYTES = 192
MAX_EXTRA_DIMENSIONS = 65_535 // EXTRA_DESCRIPTION_BYTES
"""Of a file: a record of variable length takes so many descriptions."""
_MAXIMUM_PAYLOAD = 4_000_000
_KEPT = {
    ("LASF_Projection", 2112),
    ("LASF_Projection", 34735),
    ("LASF_Projection", 34736),
    ("LASF_Projection", 34737),
    ("LASF_Spec", 4),
    ("laszip encoded", 22204),
    ("copc", 1),
}

Vector = tuple[float, float, float]


class EmptyCloud(InputError):
    """The file is sound but holds no points."""


@dataclass(frozen=True)
class CloudHeader:
    """What the header of a LAS or LAZ file says, checked against the file.

    ``bounds_low`` and ``bounds_high`` are the header's own words, in the file's units; ``bounds_trusted`` is false
    where they are not finite, reversed or beyond what the records can hold. ``count`` agrees with the file.
    ``created`` is day of the year and year; ``standard_time`` says that GPS times are not seconds of the week.
    ``vlrs`` maps (user id, record id) to the payload of the records that the engine reads. ``warnings`` are sentences.
    """

    path: Path
    version: str
    point_format: int
    record_length: int
    count: int
    scales: Vector
    offsets: Vector
    bounds_low: Vector
    bounds_high: Vector
    bounds_trusted: bool
    points_by_return: tuple[int, ...]
    offset_to_points: int
    file_size: int
    vlrs: dict[tuple[str, int], bytes]
    laz: LazLayout | None
    software: str
    file_source: int
    standard_time: bool
    created: tuple[int, int]
    warnings: tuple[str, ...]

    @property
    def compressed(self) -> bool:
        return self.laz is not None

    @property
    def copc(self) -> bool:
        return ("copc", 1) in self.vlrs

    @property
    def wkt(self) -> bytes | None:
        return self.vlrs.get(("LASF_Projection", 2112))

    @property
    def geotiff_keys(self) -> bytes | None:
        return self.vlrs.get(("LASF_Projection", 34735))

    @property
    def colours(self) -> bool:
        return self.point_format in (2, 3, 5, 7, 8, 10)


def preflight(path: Path | str) -> CloudHeader:
    """Read and check the header and the variable length records of a LAS, LAZ or COPC file.

    Raises:
        EmptyCloud: the file is sound but holds no points.
        InputError: missing, not a LAS file, cut short, or with a header that cannot be true.
    """
    path = Path(path)
    name = shown(path)
    try:
        if not path.exists():
            raise InputError(f"{name} does not exist; check the path of the point cloud.")
        if path.is_dir():
            raise InputError(f"{name} is a folder; give the LAS or LAZ file inside it.")
        with open_input(path, PART) as stream:  # what is no LAS file is said more exactly below
            return _read(stream, path, os.fstat(stream.fileno()).st_size)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{name} cannot be read ({reason}); check its name, its permissions and the disk.") from error


def _read(stream: BinaryIO, path: Path, size: int) -> CloudHeader:
    name = shown(path)
    if size == 0:
        raise InputError(f"{name} is empty (0 bytes); copy or export the point cloud again.")
    head = stream.read(393)
    form = _form(name, head, size)
    minor, offset, length = form.minor, form.offset, form.length
    scales, offsets = _scales_and_offsets(name, head)
    warnings: list[str] = []
    count, returns = _count(name, head, minor, form.legacy_count, warnings)
    vlrs = _read_vlrs(stream, name, form.header_size, offset, form.vlr_count)
    end = _end_of_points(stream, name, head, minor, offset, size, vlrs)
    extra = len(vlrs.get(("LASF_Spec", 4), b"")) // EXTRA_DESCRIPTION_BYTES
    if extra > MAX_EXTRA_DIMENSIONS:
        raise InputError(f"{name} has {extra} extra dimensions; export it with at most {MAX_EXTRA_DIMENSIONS}.")
    low, high, trusted = _bounds(name, head, scales, offsets, count, warnings)
    if count == 0:
        raise EmptyCloud(f"{name} holds no points; give a cloud with points or clip a larger area.")
    layout = None
    if form.compressed:
        block = PointBlock(name, form.point_format, length, count, offset, size)
        layout = laz_layout(stream, block, vlrs.get(("laszip encoded", 22204)))
    else:
        _compare_count(name, count, (end - offset) // length, (end - offset) - count * length, length, warnings)
    return CloudHeader(
        path=path,
        version=f"1.{minor}",
        point_format=form.point_format,
        record_length=length,
        count=count,
        scales=scales,
        offsets=offsets,
        bounds_low=low,
        bounds_high=high,
        bounds_trusted=trusted,
        points_by_return=returns,
        offset_to_points=offset,
        file_size=size,
        vlrs=vlrs,
        laz=layout,
        software=head[58:90].split(b"\0")[0].decode("ascii", "replace").strip(),
        file_source=struct.unpack_from("<H", head, 4)[0],
        standard_time=bool(head[6] & 1),
        created=struct.unpack_from("<HH", head, 90),
        warnings=tuple(warnings),
    )


@dataclass(frozen=True)
class _Form:
    """What the fixed part of a header says of the file's structure; lengths and the ``offset`` to the points in bytes.

    ``legacy_count`` is the number of points in the 32-bit field.
    """

    minor: int
    header_size: int
    offset: int
    vlr_count: int
    compressed: bool
    point_format: int
    length: int
    legacy_count: int


def _form(name: str, head: bytes, size: int) -> _Form:
    if head[:4] != b"LASF":
        raise InputError(f"{name} is not a LAS or LAZ file (its signature is missing); give a LAS or LAZ file.")
    if len(head) < 227:
        raise InputError(f"{name} is cut short inside its header ({size} bytes); copy or export it again.")
    major, minor = head[24], head[25]
    if major != 1 or minor not in _HEADER_SIZES:
        raise InputError(f"{name} says it is LAS {major}.{minor}, which is unknown; export it as LAS 1.2 or 1.4.")
    header_size, offset, vlr_count, format_byte, length, legacy = struct.unpack_from("<HIIBHI", head, 94)
    least = _HEADER_SIZES[minor]
    if header_size < least or header_size > size or len(head) < min(least, 375):
        raise InputError(
            f"{name} says its header has {header_size} bytes where LAS 1.{minor} needs {least} and the file has "
            f"{size}; copy or export it again."
        )
    if not header_size <= offset <= size:
        raise InputError(
            f"{name} says its points start at byte {offset}, outside of the file ({size} bytes) or inside the header; "
            "copy or export it again."
        )
    # LASzip marks a compressed file in bit 7 of the point format (bit 6 was used by a withdrawn variant).
    compressed, point_format = bool(format_byte & 0x80), format_byte & 0x3F
    if point_format not in POINT_SIZES or format_byte & 0x40:
        raise InputError(
            f"{name} has the unknown point format {format_byte & 0x7F}; export it with a format of 0 to 10."
        )
    if length < POINT_SIZES[point_format]:
        raise InputError(
            f"{name} says its point records have {length} bytes where point format {point_format} needs "
            f"{POINT_SIZES[point_format]}; export it again."
        )
    return _Form(minor, header_size, offset, vlr_count, compressed, point_format, length, legacy)


def _scales_and_offsets(name: str, head: bytes) -> tuple[Vector, Vector]:
    scales: Vector = struct.unpack_from("<3d", head, 131)
    offsets: Vector = struct.unpack_from("<3d", head, 155)
    for axis, scale in zip("xyz", scales, strict=True):
        # 2**31 steps must stay a distance on Earth, or the coordinates mean nothing.
        if not math.isfinite(scale) or scale <= 0 or scale > 1e3:
            raise InputError(
                f"{name} has the scale {scale:g} in {axis}, from which no coordinate follows; export it with a scale "
                "such as 0.001."
            )
    for axis, offset in zip("xyz", offsets, strict=True):
        if not math.isfinite(offset) or abs(offset) > 1e9:
            raise InputError(
                f"{name} has the offset {offset:g} in {axis}, from which no coordinate follows; export it with an "
                "offset near its coordinates."
            )
    return scales, offsets


def _count(name: str, head: bytes, minor: int, legacy: int, warnings: list[str]) -> tuple[int, tuple[int, ...]]:
    """Number of points and points by return, from the 64-bit fields where they exist."""
    returns: tuple[int, ...] = struct.unpack_from("<5I", head, 111)
    if minor < 4:
        return legacy, returns
    count: int = struct.unpack_from("<Q", head, 247)[0]
    if count == 0 and legacy:
        warnings.append(f"{name} gives its number of points only in the field of LAS 1.2 ({legacy}); that is used.")
        return legacy, returns
    if legacy not in (0, count):
        warnings.append(f"{name} says both {count} and {legacy} points in its header; the first is used.")
    return count, struct.unpack_from("<15Q", head, 255)


def _read_vlrs(stream: BinaryIO, name: str, start: int, end: int, count: int) -> dict[tuple[str, int], bytes]:
    room = (end - start) // _VLR_HEADER
    if count > min(room, _MAXIMUM_VLRS):
        raise InputError(
            f"{name} says it has {count} variable length records where at most {min(room, _MAXIMUM_VLRS)} are "
            "possible; copy or export it again."
        )
    found: dict[tuple[str, int], bytes] = {}
    position, kept = start, 0
    for index in range(count):
        stream.seek(position)
        head = stream.read(_VLR_HEADER) if position + _VLR_HEADER <= end else b""
        length = struct.unpack_from("<H", head, 20)[0] if len(head) == _VLR_HEADER else 0
        if len(head) < _VLR_HEADER or position + _VLR_HEADER + length > end:
            raise InputError(
                f"{name} has a variable length record (number {index + 1} of {count}) that runs into its points; copy "
                "or export it again."
            )
        key = _vlr_key(head)
        if key in _KEPT and key not in found and kept + length <= _MAXIMUM_PAYLOAD:
            found[key] = stream.read(length)
            kept += length
        position += _VLR_HEADER + length
    return found


def _vlr_key(head: bytes) -> tuple[str, int]:
    return head[2:18].split(b"\0")[0].decode("latin-1"), struct.unpack_from("<H", head, 18)[0]


def _end_of_points(
    stream: BinaryIO, name: str, head: bytes, minor: int, offset: int, size: int, vlrs: dict[tuple[str, int], bytes]
) -> int:
    """First byte after the points: the extended records, if there are any. Adds those that the engine reads."""
    if minor < 4:
        return size
    first, count = struct.unpack_from("<QI", head, 235)
    if count == 0:
        return size
    if not offset <= first <= size - _EVLR_HEADER or count > min(_MAXIMUM_EVLRS, (size - first) // _EVLR_HEADER):
        raise InputError(
            f"{name} says it has {count} extended records from byte {first} on, outside of the file ({size} bytes); it "
            "is cut short or damaged, so copy it again."
        )
    position = first
    for _ in range(count):
        stream.seek(position)
        record = stream.read(_EVLR_HEADER)
        length = struct.unpack_from("<Q", record, 20)[0] if len(record) == _EVLR_HEADER else size
        if position + _EVLR_HEADER + length > size:
            raise InputError(f"{name} ends inside an extended record; it is cut short or damaged, so copy it again.")
        key = _vlr_key(record)
        if key in _KEPT and key not in vlrs and length <= _MAXIMUM_PAYLOAD:
            vlrs[key] = stream.read(length)
        position += _EVLR_HEADER + length
    return int(first)


def _bounds(
    name: str, head: bytes, scales: Vector, offsets: Vector, count: int, warnings: list[str]
) -> tuple[Vector, Vector, bool]:
    """The header's bounding box and whether it can be true."""
    x1, x0, y1, y0, z1, z0 = struct.unpack_from("<6d", head, 179)
    low, high = (x0, y0, z0), (x1, y1, z1)
    if count == 0:
        return low, high, False
    possible = all(
        math.isfinite(a)
        and math.isfinite(b)
        and a <= b
        and (offset - 2**31 * scale) - scale <= a
        and b <= (offset + 2**31 * scale) + scale
        for a, b, scale, offset in zip(low, high, scales, offsets, strict=True)
    )
    if not possible:
        warnings.append(f"{name} has a bounding box in its header that cannot be true; it is computed from the points.")
    return low, high, possible


def _compare_count(name: str, count: int, held: int, rest: int, length: int, warnings: list[str]) -> None:
    if held < count:
        raise InputError(
            f"{name} holds {held} of the {count} points that its header says; it is cut short or its header is wrong, "
            "so copy or export it again."
        )
    if rest >= length:
        warnings.append(
            f"{name} has room for {held} points but its header says {count}; the {rest} bytes behind those are left "
            "out."
        )
    elif rest > 0:
        warnings.append(f"{name} has {rest} bytes behind its last point, which are left out.")
