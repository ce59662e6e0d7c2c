"""A small COPC written by its specification (1.0, https://copc.io), from the points of a LAZ file."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path

import laspy
import lazrs
import numpy as np

Key = tuple[int, int, int, int]
_HEADER_BYTES, _VLR_BYTES = 375, 54
_ENTRY = struct.Struct("<iiiiQii")


def write_copc(source: Path, output: Path, *, node_points: int = 300) -> dict[Key, int]:
    """Write the points of a file of point format 6 or 7 as COPC; how many points each node (level, x, y, z) has.

    A node keeps every k-th point of its cube, ``node_points`` at most; the others go to its eight parts.
    """
    las = laspy.read(source)
    header, raw = las.header, las.points.array
    assert header.point_format.id in (6, 7)
    middle = (header.mins + header.maxs) / 2
    half = float((header.maxs - header.mins).max()) / 2 + 0.001
    places = (np.asarray(las.xyz) - (middle - half)) / (2 * half)
    vlr = lazrs.LazVlr.new_for_compression(header.point_format.id, header.point_format.num_extra_bytes, True)
    others = [v for v in header.vlrs if v.record_id != 22204]
    records = [(v.user_id, v.record_id, v.record_data_bytes()) for v in others]
    lengths = [160, len(vlr.record_data()), *(len(data) for _, _, data in records)]
    start = _HEADER_BYTES + sum(_VLR_BYTES + n for n in lengths)
    stream = io.BytesIO(bytes(start))
    stream.seek(start)
    compressor, entries = lazrs.LasZipCompressor(stream, vlr), []
    compressor.reserve_offset_to_chunk_table()
    for key, chosen in _nodes(places, node_points):
        if entries:  # the end closes the last one
            compressor.finish_current_chunk()
        entries.append((key, stream.tell(), len(chosen)))
        compressor.compress_many(raw[chosen].tobytes())
    compressor.done()
    ends = [*(offset for _, offset, _ in entries[1:]), *struct.unpack_from("<q", stream.getbuffer(), start)]
    stream.seek(0, io.SEEK_END)
    index = b"".join(
        _ENTRY.pack(*key, offset, end - offset, points)
        for (key, offset, points), end in zip(entries, ends, strict=True)
    )
    evlr = stream.tell()
    stream.write(struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(index), b"EPT hierarchy") + index)
    spacing = 2 * half / np.sqrt(node_points)
    info = struct.pack("<5dQQ2d11Q", *middle, half, spacing, evlr + 60, len(index), 0.0, 0.0, *([0] * 11))
    data = stream.getbuffer()
    data[:start] = _head(
        header, [("copc", 1, info), ("laszip encoded", 22204, bytes(vlr.record_data())), *records], evlr
    )
    output.write_bytes(data)
    return {key: points for key, _, points in entries}


def _nodes(places: np.ndarray, most: int) -> Iterator[tuple[Key, np.ndarray]]:
    """Nodes with their points, ``places`` (n, 3) of which are from 0 to 1 in the root's cube."""
    waiting: list[tuple[Key, np.ndarray]] = [((0, 0, 0, 0), np.arange(len(places)))]
    while waiting:
        (level, x, y, z), here = waiting.pop(0)
        step = -(-len(here) // most)
        own = np.zeros(len(here), dtype=bool)
        own[::step] = True
        yield (level, x, y, z), here[own]
        rest = here[~own]
        cube = np.floor(places[rest] * 2 ** (level + 1)).astype(int)
        for part in np.unique(cube, axis=0):
            waiting.append(((level + 1, *(int(n) for n in part)), rest[(cube == part).all(axis=1)]))


def _head(header: laspy.LasHeader, records: list[tuple[str, int, bytes]], evlr: int) -> bytes:
    """Header and records of LAS 1.4, with one extended record at ``evlr``."""
    head = io.BytesIO()
    version = laspy.LasHeader(point_format=header.point_format, version="1.4")
    version.scales, version.offsets = header.scales, header.offsets
    version.write_to(head, ensure_same_size=False)
    raw = bytearray(head.getvalue()[:_HEADER_BYTES])
    body = b"".join(
        struct.pack("<H16sHH32s", 0, user.encode(), number, len(data), b"") + data for user, number, data in records
    )
    struct.pack_into("<H", raw, 6, 0x10)  # the reference system is WKT
    kind = header.point_format
    struct.pack_into(
        "<HIIBH", raw, 94, _HEADER_BYTES, _HEADER_BYTES + len(body), len(records), kind.id | 0x80, kind.size
    )
    ends = [value for axis in range(3) for value in (header.maxs[axis], header.mins[axis])]
    struct.pack_into("<6d", raw, 179, *ends)
    struct.pack_into("<QI", raw, 235, evlr, 1)
    struct.pack_into("<Q15Q", raw, 247, header.point_count, *header.number_of_points_by_return)
    return bytes(raw) + body
