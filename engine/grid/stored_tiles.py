"""The points of a survey by tiles of its grid on the disk, for clouds larger than memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..pointcloud.in_parts import SpooledCloud, point_dtype
from .grid import cell_index
from .tiled_points import Counted, Frame, Tiles, Window, counted_cells, in_window

MAX_POINTS_AT_ONCE = 2_000_000
"""Points of a window that are worked on at a time."""

Cells = tuple[NDArray[np.int32], NDArray[np.int32]]


@dataclass(frozen=True)
class StoredTiles:
    """A survey's points within the frame, tile by tile in a file, those of a tile in the cloud's order.

    Attributes:
        runs: (k, 3) of points that lie in the file one after the other: their tile, the place of the first, how many;
            by tile, and in the cloud's order within each.
        first: the first run of each tile, and at the end their number.
        known: how many more values each point has.
    """

    file: Path
    frame: Frame
    tiles: Tiles
    runs: NDArray[np.int64]
    first: NDArray[np.int64]
    known: int

    @classmethod
    def on(cls, cloud: SpooledCloud, frame: Frame, tiles: Tiles) -> StoredTiles:
        """Sort the points of a cloud by tile into a file next to its own."""
        file, known, done = cloud.file.with_suffix(".tiles"), cloud.values, 0
        found = [np.zeros((0, 3), dtype=np.int64)]
        with file.open("wb") as stream:
            for xyz, cover in cloud.parts():
                index = cell_index(xyz, frame.grid)
                here = np.flatnonzero(index >= 0)
                row, column = (place.astype(np.int32) for place in np.divmod(index[here], frame.grid.columns))
                tile = tiles.number(row, column)
                order = np.argsort(tile, kind="stable")
                records = np.empty(len(here), point_dtype(known))
                chosen = here[order]
                records["xyz"] = xyz[chosen]
                if cover is not None:
                    for k, values in enumerate((cover.error, cover.height)[:known]):
                        assert values is not None
                        records["more"][:, k] = values[chosen]
                records.tofile(stream)
                number, start, count = np.unique(tile[order], return_index=True, return_counts=True)
                found.append(np.column_stack([number, done + start, count]).astype(np.int64))
                done += len(records)
        runs = np.concatenate(found)
        runs = runs[np.argsort(runs[:, 0], kind="stable")]
        return cls(file, frame, tiles, runs, np.searchsorted(runs[:, 0], np.arange(tiles.count + 1)), known)

    def reaches(self, tile: int, within: NDArray[np.bool_]) -> bool:
        """See ``Tiled``."""
        return any(bool(within[row, column].any()) for row, column, _ in self._of_tile(tile))

    def counts(self, within: NDArray[np.bool_]) -> Counted:
        """See ``Tiled``."""
        return counted_cells((self._cells(tile) for tile in range(self.tiles.count)), self.frame, within)

    def hit(self, within: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
        """See ``Tiled``."""
        cells, count = np.zeros(within.shape, dtype=bool), 0
        for tile in range(self.tiles.count):
            for row, column, _ in self._of_tile(tile):
                chosen = within[row, column]
                cells[row[chosen], column[chosen]] = True
                count += int(np.count_nonzero(chosen))
        return cells, count

    def inside(self, window: Window) -> Iterator[tuple[Float, list[NDArray[np.floating]]]]:
        """See ``Tiled``; at most ``MAX_POINTS_AT_ONCE`` and a run at a time."""
        held: list[NDArray[np.void]] = []
        for tile in self.tiles.near(window):
            for row, column, records in self._of_tile(tile):
                held.append(records[in_window(row, column, window)])
                if sum(len(part) for part in held) > MAX_POINTS_AT_ONCE:
                    yield _values(held, self.known)
                    held = []
        if held:
            yield _values(held, self.known)

    @property
    def filled(self) -> list[int]:
        """The tiles with points."""
        return np.flatnonzero(np.diff(self.first)).tolist()

    def of_tile(self, tile: int) -> tuple[Float, list[NDArray[np.floating]]]:
        """Points (n, 3) of a tile in the cloud's order, and what else is known of each."""
        return _values([records for _, _, records in self._of_tile(tile)], self.known)

    def _cells(self, tile: int) -> Cells:
        """Rows and columns of a tile's points."""
        places = [(row, column) for row, column, _ in self._of_tile(tile)]
        nothing = np.zeros(0, dtype=np.int32)
        return np.concatenate([nothing, *(p[0] for p in places)]), np.concatenate([nothing, *(p[1] for p in places)])

    def _of_tile(self, tile: int) -> Iterator[tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.void]]]:
        """Rows, columns and records of a tile's points, run by run."""
        dtype = point_dtype(self.known)
        for _, start, count in self.runs[self.first[tile] : self.first[tile + 1]].tolist():
            records = np.fromfile(self.file, dtype, count, offset=start * dtype.itemsize)
            index = cell_index(records["xyz"], self.frame.grid)
            row, column = (place.astype(np.int32) for place in np.divmod(index, self.frame.grid.columns))
            yield row, column, records


def _values(parts: list[NDArray[np.void]], known: int) -> tuple[Float, list[NDArray[np.floating]]]:
    together = np.concatenate(parts)
    return np.ascontiguousarray(together["xyz"]), [np.ascontiguousarray(together["more"][:, k]) for k in range(known)]
