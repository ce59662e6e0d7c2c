"""Points of tiles in files: written once, read with the points of the tiles around."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float
from .layout import Tiles

POINT = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("taken", "?")])
SURFACE = np.dtype([("height", "<f8"), ("left", "?")])
FOUND = np.dtype([("height", "<f4"), ("error", "<f4"), ("plants", "<f4"), ("ground", "?")])
"""Records of a point in a tile's files: itself in the slope's frame, its height over the triangles, and what it is."""
_PIECE = 500_000
"""Points that are read at once from a tile around."""


@dataclass(frozen=True)
class Around:
    """A tile and its halo: ``flat`` (n, 3) and ``taken`` (n,), first those of the ``core`` tile itself.

    ``own`` (n - core,) says for each point of the halo which tile it is of, and ``place`` where in that tile's files.
    """

    flat: Float
    taken: Bool
    core: int
    own: NDArray[np.int32]
    place: NDArray[np.int64]


class Spool:
    """Files of the tiles' points in a folder."""

    def __init__(self, folder: Path, tiles: Tiles) -> None:
        self.folder, self.tiles = folder, tiles
        self.counts = np.zeros(len(tiles), dtype=np.int64)

    def add(self, tile: NDArray[np.int32], flat: Float, taken: Bool) -> None:
        """Append points (n, 3) in the slope's frame to their tiles' files, in the order given."""
        records = np.empty(len(flat), POINT)
        for axis, field in enumerate("xyz"):
            records[field] = flat[:, axis]
        records["taken"] = taken
        order = np.argsort(tile, kind="stable")
        numbers, first = np.unique(tile[order], return_index=True)
        for number, index in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
            with self._file(number, "points").open("ab") as stream:
                records[index].tofile(stream)
            self.counts[number] += len(index)

    def save(self, tile: int, records: NDArray[Any], kind: str) -> None:
        """Write records (n,) of the tile's own points."""
        records.tofile(self._file(tile, kind))

    def load(self, tile: int, kind: str, dtype: np.dtype[Any], start: int = 0, count: int = -1) -> NDArray[Any]:
        """Records of the tile's own points, from the one at ``start`` on; all by default."""
        return np.fromfile(self._file(tile, kind), dtype, count, offset=start * dtype.itemsize)

    def read(self, tile: int, halo: float, kinds: Sequence[tuple[str, np.dtype[Any]]] = ()) -> tuple[Any, ...]:
        """``Around`` of a tile, then an array of records (n,) for each of ``kinds`` that were saved before."""
        files = [("points", POINT), *kinds]
        own = [self.load(tile, kind, dtype) for kind, dtype in files]
        core, found = len(own[0]), [[records] for records in own]
        numbers, places = [], []
        for other in self.tiles.around(tile, halo):
            for start in range(0, int(self.counts[other]), _PIECE):
                part = [self.load(other, kind, dtype, start, _PIECE) for kind, dtype in files]
                inside = np.flatnonzero(self.tiles.within(tile, _flat(part[0]), halo))
                for records, piece in zip(found, part, strict=True):
                    records.append(piece[inside])
                numbers.append(np.full(len(inside), other, dtype=np.int32))
                places.append(inside + start)
        points = np.concatenate(found.pop(0))
        around = Around(
            _flat(points),
            np.array(points["taken"]),
            core,
            np.concatenate([np.zeros(0, np.int32), *numbers]),
            np.concatenate([np.zeros(0, np.int64), *places]),
        )
        return (around, *(np.concatenate(records) for records in found))

    def _file(self, tile: int, kind: str) -> Path:
        return self.folder / f"{tile}.{kind}"


def _flat(points: NDArray[Any]) -> Float:
    return np.column_stack([points[field] for field in "xyz"])
