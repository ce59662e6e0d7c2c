"""A cloud as COPC (specification 1.0, https://copc.io): a LAZ whose chunks are the nodes of an octree.

A node keeps one point of each cell of a grid over its cube, the first in the file; the others go to its eight parts. A
cube of few points keeps them all. Coordinates stay the file's integers.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path

import laspy
import lazrs
import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..core.errors import EngineError, InputError
from ..core.machine_memory import machine_memory
from ..core.messages import shown
from ..core.staged_outputs import atomic_output
from .header import preflight

Key = tuple[int, int, int, int]
"""Of a node: its level and its number along x, y and z."""
_HEADER_B, _VLR_B = 375, 54
_ENTRY = struct.Struct("<iiiiQii")
_CELLS = 128
"""Of a node's grid, along each side."""
_WHOLE_NODE = 20_000
"""Points that a cube keeps without parts."""
_MAX_LEVEL = 13
_POINT_B = 120
"""Memory for a point: its record twice, its place, its cell."""
_MEMORY_SHARE = 0.5
_WITH_COLOUR, _EXTENDED = (2, 3, 5, 7, 8, 10), (6, 7)
_LASZIP, _WKT = ("laszip encoded", 22204), ("LASF_Projection", 2112)


def write_copc(source: Path, output: Path) -> int:
    """Write the points of a LAS or LAZ file as COPC, in point format 6 or 7; how many nodes it has.

    Raises:
        InputError: the file cannot be read, states no WKT, or has more points than the memory takes.
    """
    header = preflight(source)
    if header.count * _POINT_B > _MEMORY_SHARE * machine_memory():
        raise InputError(
            f"{shown(source)} has {header.count} points, too many for COPC in this machine's memory; leave copc out."
        )
    if header.wkt is None:
        raise InputError(f"{shown(source)} states no reference system as text (WKT); leave copc out.")
    las = laspy.read(source)
    kind = las.header.point_format.id
    if kind not in _EXTENDED:
        las = laspy.convert(las, point_format_id=7 if kind in _WITH_COLOUR else 6, file_version="1.4")
    with atomic_output(output, lambda written: _check(written, header.count)) as partial:
        return _write(las, partial)


def _check(path: Path, count: int) -> None:
    with laspy.CopcReader.open(path) as reader:
        if len(reader.query()) != count:
            raise EngineError(f"{path.name} read back differs from what was written")


def _write(las: laspy.LasData, path: Path) -> int:
    header, raw, xyz = las.header, las.points.array, np.asarray(las.xyz)
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    middle, half = (low + high) / 2, float((high - low).max()) / 2 + 0.001
    vlr = lazrs.LazVlr.new_for_compression(header.point_format.id, header.point_format.num_extra_bytes, True)
    kept = [v for v in header.vlrs if (v.user_id, v.record_id) != _LASZIP and v.user_id != "copc"]
    records = [(v.user_id, v.record_id, v.record_data_bytes()) for v in kept]
    lengths = [160, len(vlr.record_data()), *(len(data) for _, _, data in records)]
    start = _HEADER_B + sum(_VLR_B + n for n in lengths)
    with path.open("w+b") as stream:
        stream.write(bytes(start))
        entries: list[tuple[Key, int, int]] = []
        compressor = lazrs.LasZipCompressor(stream, vlr)
        compressor.reserve_offset_to_chunk_table()
        for key, chosen in _nodes((xyz - (middle - half)) / (2 * half)):
            if entries:  # the end closes the last one
                compressor.finish_current_chunk()
            entries.append((key, stream.tell(), len(chosen)))
            compressor.compress_many(raw[chosen].tobytes())
        compressor.done()
        stream.seek(start)
        ends = [*(offset for _, offset, _ in entries[1:]), *struct.unpack("<q", stream.read(8))]
        index = b"".join(
            _ENTRY.pack(*key, offset, end - offset, points)
            for (key, offset, points), end in zip(entries, ends, strict=True)
        )
        evlr = stream.seek(0, io.SEEK_END)
        stream.write(struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(index), b"EPT hierarchy") + index)
        info = _info(middle, half, evlr, len(index), np.asarray(las.gps_time))
        stream.seek(0)
        stream.write(_head(las, [("copc", 1, info), (*_LASZIP, bytes(vlr.record_data())), *records], evlr))
    return len(entries)


def _info(middle: Float, half: float, evlr: int, index_bytes: int, times: Float) -> bytes:
    first, last = (float(times.min()), float(times.max())) if len(times) else (0.0, 0.0)
    spacing = 2 * half / _CELLS
    return struct.pack("<5dQQ2d11Q", *middle, half, spacing, evlr + 60, index_bytes, first, last, *([0] * 11))


def _nodes(places: Float) -> Iterator[tuple[Key, NDArray[np.int64]]]:
    """Nodes with the numbers of their points, level by level; ``places`` (n, 3) are from 0 to 1 in the root's cube."""
    left = np.arange(len(places))
    for level in range(_MAX_LEVEL + 1):
        if not len(left):
            return
        # 20 bits for each axis hold the cells of the last level
        cell = np.minimum(np.floor(places[left] * (_CELLS << level)), (_CELLS << level) - 1).astype(np.int64)
        node = _packed(cell // _CELLS)
        _, number, counts = np.unique(node, return_inverse=True, return_counts=True)
        own = counts[number] <= _WHOLE_NODE if level < _MAX_LEVEL else np.ones(len(left), dtype=bool)
        own[np.unique(_packed(cell), return_index=True)[1]] = True
        order = np.argsort(node[own], kind="stable")
        keys, starts = np.unique(node[own][order], return_index=True)
        for key, chosen in zip(keys.tolist(), np.split(left[own][order], starts[1:]), strict=True):
            yield (level, key >> 42, (key >> 21) & 0x1FFFFF, key & 0x1FFFFF), chosen
        left = left[~own]


def _packed(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Three whole numbers below 2^21 as one."""
    packed: NDArray[np.int64] = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    return packed


def _head(las: laspy.LasData, records: list[tuple[str, int, bytes]], evlr: int) -> bytes:
    """Header and records of LAS 1.4, with one extended record at ``evlr``."""
    source, kind = las.header, las.header.point_format
    head = io.BytesIO()
    plain = laspy.LasHeader(point_format=kind, version="1.4")
    plain.scales, plain.offsets, plain.creation_date = source.scales, source.offsets, source.creation_date
    plain.generating_software, plain.system_identifier = source.generating_software, source.system_identifier
    plain.write_to(head, ensure_same_size=False)
    raw = bytearray(head.getvalue()[:_HEADER_B])
    body = b"".join(
        struct.pack("<H16sHH32s", 0, user.encode(), number, len(data), b"") + data for user, number, data in records
    )
    time_bit = int(source.global_encoding.gps_time_type)
    struct.pack_into("<H", raw, 6, 0x10 | time_bit)  # the reference system is WKT
    struct.pack_into("<HIIBH", raw, 94, _HEADER_B, _HEADER_B + len(body), len(records), kind.id | 0x80, kind.size)
    low, high = np.asarray(las.xyz).min(axis=0), np.asarray(las.xyz).max(axis=0)
    struct.pack_into("<6d", raw, 179, *(value for axis in range(3) for value in (high[axis], low[axis])))
    struct.pack_into("<QI", raw, 235, evlr, 1)
    returns = np.bincount(np.asarray(las.return_number), minlength=16)[1:16]
    struct.pack_into("<Q15Q", raw, 247, len(las.points), *returns.tolist())
    return bytes(raw) + body
