"""Point records of LAS files as laspy has them, with a field for each extra dimension; reading them in groups.

laspy's own reader is not used: it parses all records of variable length, however long, and stops at some that are odd.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import BinaryIO

import laspy
import lazrs
import numpy as np
from laspy import DecompressionSelection, PackedPointRecord
from laspy.extradims import get_id_for_extra_dim_type
from laspy.vlrs.known import ExtraBytesStruct
from numpy.typing import NDArray

from ...interface.input_files import CLOUD
from ..core.arrays import Float
from ..core.errors import EngineError, InputError
from ..core.input_files import open_input
from ..core.messages import shown
from .header import POINT_SIZES, CloudHeader, Vector
from .laz_chunks import check_chunks

PLACES = DecompressionSelection.XY_RETURNS_CHANNEL | DecompressionSelection.Z
"""Coordinates and return numbers, see ``read_records``."""
_GROUP_BYTES = 8 << 20  # what handles a group holds several times as much
_STRETCH = 50_000
"""Points that a file without chunks is read in; LAZ files mostly have chunks of as many."""


@dataclass(frozen=True)
class ExtraDimension:
    """A dimension behind a point format's own: its name, numpy type and the 192 bytes that describe it in the file.

    Bytes that nothing describes have an empty descriptor; they come last.
    """

    name: str
    dtype: np.dtype[np.generic]
    descriptor: bytes

    @property
    def field(self) -> str:
        """Its field in records, which cannot meet the point format's own."""
        return f"extra:{self.name}"

    def values(self, records: PackedPointRecord) -> NDArray[np.generic]:
        """Its single numbers (n,) in some records as the file means them, with its scale and offset."""
        values: NDArray[np.generic] = records.array[self.field]
        described = ExtraBytesStruct.from_buffer_copy(self.descriptor)
        for factor in described.scale or ():
            values = values * np.float64(factor)
        for offset in described.offset or ():
            values = values + np.float64(offset)
        return values


def new_dimension(name: str, dtype: np.dtype[np.generic], description: str = "") -> ExtraDimension:
    """Describe an extra dimension.

    Raises:
        EngineError: a name that is too long, or a type that LAS has not.
    """
    raw, kind = name.encode("utf-8"), np.dtype(dtype).newbyteorder("<")
    try:
        code = get_id_for_extra_dim_type(kind)
    except laspy.errors.UnknownExtraType:
        code = 0
    if not code or not 0 < len(raw) <= 32:
        raise EngineError(f"{name!r} of type {dtype} cannot be a dimension of a LAS file")
    about = description.encode()[:32].ljust(32, b"\0")
    return ExtraDimension(name, kind, bytes([0, 0, code, 0]) + raw.ljust(32, b"\0") + bytes(124) + about)


def extra_dimensions(header: CloudHeader) -> list[ExtraDimension]:
    """The extra dimensions of a file; bytes that its record ``LASF_Spec`` 4 does not describe are the last."""
    left = header.record_length - POINT_SIZES[header.point_format]
    described = header.vlrs.get(("LASF_Spec", 4), b"")
    found: dict[str, ExtraDimension] = {}
    for start in range(0, len(described) - 191, 192):
        one = ExtraBytesStruct.from_buffer_copy(described, start)
        name = one.name.decode("utf-8", "replace")
        # type 0 is raw bytes, as many as the options say
        dtype = one.dtype() if 0 < one.data_type <= 30 else np.dtype(f"V{max(1, one.options)}")
        if not name or name in found or dtype.itemsize > left:
            break
        left -= dtype.itemsize
        found[name] = ExtraDimension(name, dtype, described[start : start + 192])
    return [*found.values(), *([ExtraDimension("undescribed", np.dtype(f"V{left}"), b"")] if left else [])]


def record_dtype(point_format: int, extra: Sequence[ExtraDimension] = ()) -> np.dtype[np.void]:
    """Structure of one point record: laspy's fields, then those of the extra dimensions."""
    return np.dtype(laspy.PointFormat(point_format).dtype().descr + [(d.field, d.dtype) for d in extra])


def coordinates(records: PackedPointRecord, header: CloudHeader, factors: Vector = (1.0, 1.0, 1.0)) -> Float:
    """Coordinates (n, 3) of some of a file's records, times ``factors``."""
    xyz = np.empty((len(records), 3))
    for axis, (field, factor) in enumerate(zip("XYZ", factors, strict=True)):
        np.multiply(records[field], header.scales[axis] * factor, out=xyz[:, axis])
        xyz[:, axis] += header.offsets[axis] * factor
    return xyz


def read_records(
    header: CloudHeader,
    *,
    selection: DecompressionSelection | None = None,
    warnings: list[str] | None = None,
    stretches: int | None = None,
    starts: Collection[int] | None = None,
) -> Iterator[PackedPointRecord]:
    """The records in the order of the file, in groups of at most about 8 MB (one chunk where chunks are larger).

    Args:
        selection: what is needed; the rest may be zero. None: all.
        warnings: takes sentences about a file that contradicts its header.
        stretches: only so many chunks (50,000 points of a file without chunks), evenly over the file, one a group.
        starts: only the chunks that begin at these bytes of the file.

    Raises:
        InputError: the compressed points are damaged, or the file changed or ends while it is read.
    """
    name, layout = shown(header.path), header.laz
    dtype = record_dtype(header.point_format, extra_dimensions(header))
    point_format = laspy.PointFormat(header.point_format)
    limit = max(1, _GROUP_BYTES // dtype.itemsize)
    chosen = None if selection is None else selection.to_lazrs()
    try:
        with open_input(header.path, CLOUD) as stream:
            chunks = _pieces(header, limit) if layout is None else _chunks(stream, header, warnings)
            places = np.cumsum([header.offset_to_points + 8 * header.compressed, *(size for _, size in chunks)])
            groups = _groups(chunks, limit) if stretches is None else _evenly(len(chunks), stretches)
            if starts is not None:
                groups = _those_at(chunks, places, starts, limit)
            for first, last in groups:
                group = chunks[first:last]
                stream.seek(int(places[first]))
                data = stream.read(int(places[last] - places[first]))
                if len(data) < places[last] - places[first]:
                    raise InputError(f"{name} became shorter while it was read; copy it again.")
                if layout is None:
                    yield PackedPointRecord(np.frombuffer(data, dtype), point_format)
                    continue
                out = np.zeros(sum(points for points, _ in group), dtype)
                lazrs.decompress_points_with_chunk_table(data, layout.record, out.view(np.uint8), group, chosen)
                yield PackedPointRecord(out, point_format)
    except OSError as error:
        raise InputError(f"{name} cannot be read ({error.strerror}); check the disk.") from error
    except (lazrs.LazrsError, ValueError, IndexError) as error:
        raise InputError(f"{name} is damaged inside its compressed points ({error}); copy it again.") from error
    except BaseException as error:
        # A panic of the decompressor arrives as an exception that is not an Exception.
        if type(error).__name__ != "PanicException":
            raise
        raise InputError(f"{name} is damaged inside its compressed points; copy it again from its source.") from error


def _pieces(header: CloudHeader, limit: int) -> list[tuple[int, int]]:
    """Points and bytes of the pieces in which a file without chunks is read."""
    step = min(_STRETCH, limit)
    points = [min(step, header.count - start) for start in range(0, header.count, step)]
    return [(number, number * header.record_length) for number in points]


def _chunks(stream: BinaryIO, header: CloudHeader, warnings: list[str] | None) -> list[tuple[int, int]]:
    """Points and bytes of each compressed chunk, all checked before one of them is decompressed."""
    layout = header.laz
    assert layout is not None
    stream.seek(header.offset_to_points)
    chunks = [(int(p), int(b)) for p, b in lazrs.read_chunk_table(stream, lazrs.LazVlr(layout.record))]
    if layout.chunk_size:  # the table of equal chunks does not know that the last one is shorter
        last = header.count - layout.chunk_size * (len(chunks) - 1)
        chunks = [(layout.chunk_size, size) for _, size in chunks[:-1]] + [(last, chunks[-1][1])]
    odd = check_chunks(stream, layout, chunks)
    if odd and warnings is not None:
        warnings.append(odd)
    return chunks


def _groups(chunks: list[tuple[int, int]], limit: int) -> Iterator[tuple[int, int]]:
    """First chunk and the one after the last of groups that hold at most ``limit`` points, or one chunk."""
    firsts, held = [0], 0
    for number, (points, _) in enumerate(chunks):
        if held and held + points > limit:
            firsts.append(number)
            held = 0
        held += points
    return pairwise([*firsts, len(chunks)])


def _those_at(
    chunks: list[tuple[int, int]], places: NDArray[np.integer], starts: Collection[int], limit: int
) -> Iterator[tuple[int, int]]:
    """As ``_groups``, of the chunks that begin at the places ``starts``."""
    first, held = -1, 0
    for number, (points, _) in enumerate(chunks):
        taken = int(places[number]) in starts
        if first >= 0 and (not taken or held + points > limit):
            yield first, number
            first = -1
        if taken:
            first, held = (number, points) if first < 0 else (first, held + points)
    if first >= 0:
        yield first, len(chunks)


def _evenly(count: int, wanted: int) -> Iterator[tuple[int, int]]:
    """At most ``wanted`` of ``count`` chunks as groups, evenly apart, the first and the last among them."""
    numbers = np.unique(np.linspace(0, count - 1, min(wanted, count)).round())
    return ((int(i), int(i) + 1) for i in numbers)
