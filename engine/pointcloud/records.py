"""Point records of LAS files as numpy structures, and reading them in groups, compressed or not."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.messages import shown
from .header import CloudHeader
from .laz_chunks import check_chunks

_OLD = [("X", "<i4"), ("Y", "<i4"), ("Z", "<i4"), ("intensity", "<u2"), ("flags", "u1"), ("classification", "u1")]
_OLD += [("scan_angle", "i1"), ("user_data", "u1"), ("point_source_id", "<u2")]
_NEW = [("X", "<i4"), ("Y", "<i4"), ("Z", "<i4"), ("intensity", "<u2"), ("flags", "u1"), ("more_flags", "u1")]
_NEW += [("classification", "u1"), ("user_data", "u1"), ("scan_angle", "<i2"), ("point_source_id", "<u2")]
_TIME = [("gps_time", "<f8")]
_RGB = [("red", "<u2"), ("green", "<u2"), ("blue", "<u2")]
_NIR = [("nir", "<u2")]
_WAVE = [("waveform", "V29")]
_FIELDS = {
    0: _OLD,
    1: _OLD + _TIME,
    2: _OLD + _RGB,
    3: _OLD + _TIME + _RGB,
    4: _OLD + _TIME + _WAVE,
    5: _OLD + _TIME + _RGB + _WAVE,
    6: _NEW + _TIME,
    7: _NEW + _TIME + _RGB,
    8: _NEW + _TIME + _RGB + _NIR,
    9: _NEW + _TIME + _WAVE,
    10: _NEW + _TIME + _RGB + _NIR + _WAVE,
}
_GROUP_BYTES = 32 << 20
_STRETCH = 50_000
"""Points in a row that a sample takes of a file without chunks; LAZ files mostly have chunks of as many."""


def record_dtype(point_format: int, record_length: int) -> np.dtype[np.void]:
    """Structure of one point record; bytes beyond the format's own are the field ``extra``."""
    fields = list(_FIELDS[point_format])
    extra = record_length - np.dtype(fields).itemsize
    if extra:
        fields.append(("extra", f"V{extra}"))
    return np.dtype(fields)


def classes(records: NDArray[np.void], point_format: int) -> NDArray[np.uint8]:
    """Class of each record, without the flags that older formats keep in the same byte."""
    values: NDArray[np.uint8] = records["classification"]
    return values & np.uint8(0x1F) if point_format < 6 else values


def return_numbers(records: NDArray[np.void], point_format: int) -> NDArray[np.uint8]:
    """Return number of each record."""
    values: NDArray[np.uint8] = records["flags"]
    return values & np.uint8(0x07 if point_format < 6 else 0x0F)


def return_totals(records: NDArray[np.void], point_format: int) -> NDArray[np.uint8]:
    """Number of returns of each record's pulse."""
    values: NDArray[np.uint8] = records["flags"]
    return (values >> np.uint8(3)) & np.uint8(0x07) if point_format < 6 else values >> np.uint8(4)


def read_records(
    header: CloudHeader,
    *,
    selection: int | None = None,
    warnings: list[str] | None = None,
    stretches: int | None = None,
) -> Iterator[NDArray[np.void]]:
    """The records in the order of the file, in groups of at most about 32 MB (one chunk where chunks are larger).

    Args:
        selection: bits of ``lazrs.SELECTIVE_DECOMPRESS_*`` of what is needed; the rest may be zero. None: all.
        warnings: takes sentences about a file that contradicts its header.
        stretches: only so many chunks (50,000 points of a file without chunks), evenly over the file, one a group.

    Raises:
        InputError: the compressed points are damaged, or the file changed or ends while it is read.
    """
    yield from (_compressed(header, selection, warnings, stretches) if header.compressed else _plain(header, stretches))


def _plain(header: CloudHeader, stretches: int | None) -> Iterator[NDArray[np.void]]:
    dtype = record_dtype(header.point_format, header.record_length)
    step = max(1, _GROUP_BYTES // dtype.itemsize) if stretches is None else _STRETCH
    starts = range(0, header.count, step)
    try:
        with header.path.open("rb") as stream:
            for start in starts if stretches is None else [starts[i] for i in _evenly(len(starts), stretches)]:
                stream.seek(header.offset_to_points + start * dtype.itemsize)
                number = min(step, header.count - start)
                data = stream.read(number * dtype.itemsize)
                if len(data) < number * dtype.itemsize:
                    raise InputError(f"{shown(header.path)} became shorter while it was read; copy it again.")
                yield np.frombuffer(data, dtype)
    except OSError as error:
        raise InputError(f"{shown(header.path)} cannot be read ({error.strerror}); check the disk.") from error


def _compressed(
    header: CloudHeader, selection: int | None, warnings: list[str] | None, stretches: int | None
) -> Iterator[NDArray[np.void]]:
    import lazrs

    layout = header.laz
    assert layout is not None
    name = shown(header.path)
    dtype = record_dtype(header.point_format, header.record_length)
    chosen = None if selection is None else lazrs.DecompressionSelection(selection)
    try:
        with header.path.open("rb") as stream:
            stream.seek(header.offset_to_points)
            chunks = [(int(p), int(b)) for p, b in lazrs.read_chunk_table(stream, lazrs.LazVlr(layout.record))]
            if layout.chunk_size:  # the table of equal chunks does not know that the last one is shorter
                last = header.count - layout.chunk_size * (len(chunks) - 1)
                chunks = [(layout.chunk_size, size) for _, size in chunks[:-1]] + [(last, chunks[-1][1])]
            odd = check_chunks(stream, name, layout, chunks, header.offset_to_points, dtype.itemsize, header.count)
            if odd and warnings is not None:
                warnings.append(odd)
            places = header.offset_to_points + 8 + np.concatenate([[0], np.cumsum([size for _, size in chunks])])
            groups = _groups(chunks, max(1, _GROUP_BYTES // dtype.itemsize))
            if stretches is not None:
                groups = ((i, [chunks[i]]) for i in _evenly(len(chunks), stretches))
            for first, group in groups:
                stream.seek(int(places[first]))
                compressed = stream.read(sum(size for _, size in group))
                out = np.zeros(sum(points for points, _ in group), dtype)
                lazrs.decompress_points_with_chunk_table(compressed, layout.record, out.view(np.uint8), group, chosen)
                yield out
    except (lazrs.LazrsError, OSError, ValueError, IndexError) as error:
        raise InputError(f"{name} is damaged inside its compressed points ({error}); copy it again.") from error
    except (InputError, GeneratorExit, KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:
        # A panic of the decompressor arrives as an exception that is not an Exception.
        if type(error).__name__ != "PanicException":
            raise
        raise InputError(f"{name} is damaged inside its compressed points; copy it again from its source.") from error


def _groups(chunks: list[tuple[int, int]], limit: int) -> Iterator[tuple[int, list[tuple[int, int]]]]:
    """Chunks that hold at most ``limit`` points together, with the number of the first of them."""
    group: list[tuple[int, int]] = []
    first = held = 0
    for number, chunk in enumerate(chunks):
        if group and held + chunk[0] > limit:
            yield first, group
            group, first, held = [], number, 0
        group.append(chunk)
        held += chunk[0]
    if group:
        yield first, group


def _evenly(count: int, wanted: int) -> list[int]:
    """At most ``wanted`` of the numbers below ``count``, evenly apart, the first and the last among them."""
    return [int(i) for i in np.unique(np.linspace(0, count - 1, min(wanted, count)).round())]
