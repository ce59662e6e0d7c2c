"""Which chunks of a COPC hold the points within some bounds or of its coarser levels: its index, read without trusting
it.

A COPC is a LAZ whose chunks are the nodes of an octree (COPC specification 1.0, https://copc.io). Its index says where
each node lies and at which byte its chunk begins.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...interface.input_files import CLOUD
from ..core.arrays import Float
from ..core.input_files import open_input
from ..crs.working_frame import WorkingFrame
from .header import CloudHeader
from .records import extra_dimensions, read_records
from .writing import Layout, laz_writer

_INFO = struct.Struct("<5dQQ")
_ENTRY = np.dtype([("level", "<i4"), ("key", "<i4", (3,)), ("offset", "<u8"), ("size", "<i4"), ("points", "<i4")])
_MAX_PAGES, _MAX_PAGE_BYTES, _MAX_LEVEL = 100_000, 1 << 28, 40
_PAGE = -1
"""Points of an entry that names another page of the index."""
MAX_READ_SHARE = 0.8
"""Share of the points from which on a file is read as a whole."""


@dataclass(frozen=True)
class NearChunks:
    """The bytes at which chunks begin, and how many points these hold."""

    starts: frozenset[int]
    points: int


Bounds = tuple[Float, Float]
"""Low and high corner, (2,) each, in the file's units and seen from above; their edges belong to them."""


def chunks_near(header: CloudHeader, low: Float, high: Float) -> NearChunks | None:
    """The chunks that can hold points between ``low`` and ``high`` (2,), in the file's units and seen from above.

    None where that is no COPC, its index contradicts the file, or nearly all or none are near: then all are to be read.
    """
    return chosen_chunks(header, (low, high))


def chosen_chunks(header: CloudHeader, bounds: Bounds | None, spacing: float | None = None) -> NearChunks | None:
    """The chunks that can hold points within ``bounds``, of the levels down to the first whose points are not farther
    apart than ``spacing``, in the file's units; None: all.

    A level has the points of those above it, and half their distance. See ``chunks_near`` for when there are none.
    """
    info = header.vlrs.get(("copc", 1), b"")
    if len(info) < _INFO.size:
        return None
    *middle, half, coarsest, offset, size = _INFO.unpack_from(info)
    if not (np.isfinite([*middle, half, coarsest]).all() and half > 0):
        return None
    with open_input(header.path, CLOUD) as stream:
        nodes = _nodes(stream, header.file_size, offset, size)
    if nodes is None or int(nodes["points"].sum()) != header.count:
        return None
    wanted = np.ones(len(nodes), dtype=bool)
    if spacing is not None and coarsest > 0:
        wanted = nodes["level"] <= max(0, math.ceil(math.log2(coarsest / spacing) - 1e-9))
    if bounds is not None:
        side = 2.0 * half / 2.0 ** nodes["level"]
        corner = np.array(middle[:2]) - half + nodes["key"][:, :2] * side[:, None]
        slack = np.array(header.scales[:2])  # by which a node's points can be rounded
        low, high = bounds
        wanted &= ((corner - slack <= high) & (corner + side[:, None] + slack >= low)).all(axis=1)
    points = int(nodes["points"][wanted].sum())
    if not 0 < points <= MAX_READ_SHARE * header.count:
        return None
    return NearChunks(frozenset(nodes["offset"][wanted].tolist()), points)


def write_near(header: CloudHeader, frame: WorkingFrame, near: NearChunks, output: Path) -> None:
    """Copy the points of some chunks, in the order of the file, each with all its integers.

    Raises:
        InputError: as ``read_records`` and ``laz_writer``.
    """
    layout = Layout(header.point_format, tuple(extra_dimensions(header)), header.scales, header.offsets, frame.crs)
    with laz_writer(output, layout, near.points, header) as write:
        for records in read_records(header, starts=near.starts):
            write(records.array)


def _nodes(stream: BinaryIO, file_size: int, offset: int, size: int) -> np.ndarray | None:
    """The nodes with points of all pages of the index; None where it is damaged."""
    found, pages = [np.zeros(0, _ENTRY)], [(offset, size)]
    seen: set[int] = set()
    while pages:
        offset, size = pages.pop()
        sound = 0 < size <= _MAX_PAGE_BYTES and size % _ENTRY.itemsize == 0 and 0 <= offset <= file_size - size
        if not sound or offset in seen or len(seen) >= _MAX_PAGES:
            return None
        seen.add(offset)
        stream.seek(offset)
        page = np.frombuffer(stream.read(size), _ENTRY)
        level, key = page["level"], page["key"]
        if not ((level >= 0) & (level <= _MAX_LEVEL)).all() or (key < 0).any() or (page["points"] < _PAGE).any():
            return None
        others = page[page["points"] == _PAGE]
        pages += zip(others["offset"].tolist(), others["size"].tolist(), strict=True)
        found.append(page[page["points"] > 0])
    return np.concatenate(found)
