"""The points of a survey by tiles of its grid, so that large grids are worked on part by part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..pointcloud.plant_cover import PlantCover
from .grid import Grid, cell_index
from .grown_cells import PRIOR_RADIUS_BLOCKS

_AT_ONCE = 1_000_000  # cells of a grid that is worked on as a whole
_TILE = 384  # cells along the side of a part of a larger one

Window = tuple[slice, slice]
Counted = tuple[NDArray[np.int64], NDArray[np.int32]]
"""Flat indices of cells, ascending, and how many points each has."""


@dataclass(frozen=True)
class Frame:
    """A grid whose edges are multiples of the largest block, and where the given one lies in it."""

    grid: Grid
    top: int
    left: int
    shape: tuple[int, int]

    @classmethod
    def around(cls, grid: Grid, multiple: int) -> Frame:
        first = round(grid.west / grid.cell) % multiple
        above = -round(grid.north / grid.cell) % multiple
        rows, columns = (-(-(a + b) // multiple) * multiple for a, b in ((above, grid.rows), (first, grid.columns)))
        west, north = grid.west - first * grid.cell, grid.north + above * grid.cell
        return cls(Grid(west, north, grid.cell, rows, columns), above, first, grid.shape)

    def cut(self, array: NDArray) -> NDArray:
        return array[self.top : self.top + self.shape[0], self.left : self.left + self.shape[1]]

    def padded(self, array: NDArray, fill: object) -> NDArray:
        whole = np.full(self.grid.shape, fill, dtype=array.dtype)
        self.cut(whole)[:] = array
        return whole

    def part(self, window: Window) -> Grid:
        """The grid of a window of the frame."""
        rows, columns = window
        return Grid(
            self.grid.west + columns.start * self.grid.cell,
            self.grid.north - rows.start * self.grid.cell,
            self.grid.cell,
            rows.stop - rows.start,
            columns.stop - columns.start,
        )


@dataclass(frozen=True)
class Tiles:
    """Squares of the frame that are worked on one after the other; their edges are multiples of the largest block.

    The margin around one holds the blocks around a block, from which its error is estimated. A small frame is one tile
    without a margin.
    """

    shape: tuple[int, int]
    side: tuple[int, int]
    margin: int

    @classmethod
    def of(cls, shape: tuple[int, int], multiple: int) -> Tiles:
        if shape[0] * shape[1] <= _AT_ONCE:
            return cls(shape, (max(shape[0], 1), max(shape[1], 1)), 0)
        side = multiple * max(1, _TILE // multiple)
        return cls(shape, (side, side), multiple * (PRIOR_RADIUS_BLOCKS + 1))

    @property
    def across(self) -> int:
        return -(-self.shape[1] // self.side[1])

    @property
    def count(self) -> int:
        return -(-self.shape[0] // self.side[0]) * self.across

    def number(self, row: NDArray[np.int32], column: NDArray[np.int32]) -> NDArray[np.int32]:
        """The tile of each cell."""
        return row // np.int32(self.side[0]) * np.int32(self.across) + column // np.int32(self.side[1])

    def window(self, number: int) -> Window:
        """Rows and columns of a tile."""
        i, j = divmod(number, self.across)
        return (
            slice(i * self.side[0], min((i + 1) * self.side[0], self.shape[0])),
            slice(j * self.side[1], min((j + 1) * self.side[1], self.shape[1])),
        )

    def widened(self, window: Window, margin: int) -> Window:
        """A window with ``margin`` more rows and columns on each side, within the frame."""
        rows, columns = (
            slice(max(part.start - margin, 0), min(part.stop + margin, end))
            for part, end in zip(window, self.shape, strict=True)
        )
        return rows, columns

    def near(self, window: Window) -> Iterator[int]:
        """The tiles that a window of the frame reaches, row by row."""
        first, last = ([part.start for part in window], [part.stop - 1 for part in window])
        for i in range(first[0] // self.side[0], last[0] // self.side[0] + 1):
            for j in range(first[1] // self.side[1], last[1] // self.side[1] + 1):
                yield i * self.across + j

    def windows(self, epochs: Sequence[Reaching], within: NDArray[np.bool_]) -> Iterator[tuple[Window, Window]]:
        """Windows of the frame to work on, and the part of each that counts; only those in which both surveys have
        points, as points in the margin fill blocks of the neighbour only.
        """
        for number in range(self.count):
            inner = self.window(number)
            if self.count > 1 and not all(epoch.reaches(number, within) for epoch in epochs):
                continue
            yield self.widened(inner, self.margin), inner


class Reaching(Protocol):
    """What has points in some tiles of a frame."""

    def reaches(self, tile: int, within: NDArray[np.bool_]) -> bool:
        """Whether a point of the tile is ``within`` (frame's rows, columns)."""


class Tiled(Protocol):
    """A survey's points by tiles of a frame."""

    @property
    def frame(self) -> Frame: ...

    @property
    def tiles(self) -> Tiles: ...

    @property
    def known(self) -> int:
        """How many more values each point has."""

    def reaches(self, tile: int, within: NDArray[np.bool_]) -> bool:
        """Whether a point of the tile is ``within`` (frame's rows, columns)."""

    def counts(self, within: NDArray[np.bool_]) -> Counted:
        """Cells of the grid within the frame that have points, and how many; of ``within`` (frame's rows, columns)."""

    def hit(self, within: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
        """Cells (rows, columns) of ``within`` that have points, and how many points these are."""

    def inside(self, window: Window) -> Iterator[tuple[Float, list[NDArray[np.floating]]]]:
        """Points (n, 3) in a window of the frame, and what else is known of each, those of each cell in the cloud's
        order; in parts where there are many.
        """


@dataclass(frozen=True)
class TiledPoints:
    """A survey's points within the frame, their rows and columns there, and what else is known of each.

    ``order`` are the points tile by tile, in the cloud's order within each; ``start`` where each tile begins.
    """

    xyz: Float
    row: NDArray[np.int32]
    column: NDArray[np.int32]
    more: list[NDArray[np.floating]]
    frame: Frame
    tiles: Tiles
    order: NDArray[np.integer]
    start: NDArray[np.int64]

    @classmethod
    def on(cls, cloud: Float, frame: Frame, tiles: Tiles, cover: PlantCover | None) -> TiledPoints:
        more = [] if cover is None else [cover.error] if cover.height is None else [cover.error, cover.height]
        index = cell_index(cloud, frame.grid)
        if index.size and index.min() < 0:
            known = index >= 0
            index, cloud, more = index[known], cloud[known], [values[known] for values in more]
        row, column = (place.astype(np.int32) for place in np.divmod(index, frame.grid.columns))
        del index
        tile = tiles.number(row, column)
        order = np.argsort(tile, kind="stable").astype(np.int32 if len(row) < 2**31 else np.int64)
        start = np.concatenate([[0], np.cumsum(np.bincount(tile, minlength=tiles.count))])
        return cls(cloud, row, column, list(more), frame, tiles, order, start)

    @property
    def known(self) -> int:
        """How many more values each point has."""
        return len(self.more)

    def of_tile(self, number: int) -> NDArray[np.integer]:
        """The points of a tile."""
        return self.order[self.start[number] : self.start[number + 1]]

    def reaches(self, tile: int, within: NDArray[np.bool_]) -> bool:
        """Whether a point of the tile is ``within`` (frame's rows, columns)."""
        here = self.of_tile(tile)
        return bool(within[self.row[here], self.column[here]].any())

    def counts(self, within: NDArray[np.bool_]) -> Counted:
        """Cells of the grid within the frame that have points, and how many; of ``within`` (frame's rows, columns)."""
        return counted_cells(self._places(), self.frame, within)

    def _places(self) -> Iterator[tuple[NDArray[np.int32], NDArray[np.int32]]]:
        """Rows and columns of the points of each tile."""
        for tile in range(self.tiles.count):
            here = self.of_tile(tile)
            yield self.row[here], self.column[here]

    def hit(self, within: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
        """Cells (rows, columns) of ``within`` that have points, and how many points these are."""
        cells = np.zeros(within.shape, dtype=bool)
        chosen = within[self.row, self.column]
        cells[self.row[chosen], self.column[chosen]] = True
        return cells, int(chosen.sum())

    def inside(self, window: Window) -> Iterator[tuple[Float, list[NDArray[np.floating]]]]:
        """See ``Tiled.inside``; in one part."""
        here = self._inside(window)
        yield self.xyz[here], [values[here] for values in self.more]

    def _inside(self, window: Window) -> NDArray[np.integer]:
        """Points in a window of the frame, those of each cell in the cloud's order."""
        if self.tiles.count == 1:
            return np.arange(len(self.row))
        near = np.concatenate([self.of_tile(number) for number in self.tiles.near(window)])
        return near[in_window(self.row[near], self.column[near], window)]


def in_window(row: NDArray[np.int32], column: NDArray[np.int32], window: Window) -> NDArray[np.bool_]:
    """Which of the cells (n,) of the frame lie in a window of it."""
    rows, columns = window
    return (row >= rows.start) & (row < rows.stop) & (column >= columns.start) & (column < columns.stop)


def counted_cells(
    places: Iterable[tuple[NDArray[np.int32], NDArray[np.int32]]], frame: Frame, within: NDArray[np.bool_]
) -> Counted:
    """See ``Tiled.counts``; ``places`` are rows and columns in the frame, those of a cell all in one part."""
    cells: list[NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)]
    counts: list[NDArray[np.int32]] = [np.zeros(0, dtype=np.int32)]
    rows, columns = frame.shape
    for row, column in places:
        row, column = row[chosen := within[row, column]] - frame.top, column[chosen] - frame.left
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        row, column = row[inside], column[inside]
        if not row.size:
            continue
        corner, width = (int(row.min()), int(column.min())), int(np.ptp(column)) + 1
        count = np.bincount((row - corner[0]).astype(np.int64) * width + column - corner[1])
        found = np.flatnonzero(count)
        i, j = np.divmod(found, width)
        cells.append((i + corner[0]) * columns + j + corner[1])
        counts.append(count[found].astype(np.int32))
    cell, number = np.concatenate(cells), np.concatenate(counts)
    order = np.argsort(cell, kind="stable")
    return cell[order], number[order]
