"""Which cells of a grid are one: each a part of its own, or a part of the block that it grew into."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Bool, Float, Index
from ..statistics.layout import Layout, Window

Parts = NDArray[np.signedinteger[Any]]
"""Number of each cell's part (rows, columns) from 0; -1: in none."""


@dataclass(frozen=True)
class Partition:
    """The parts of a grid of ``shape`` (rows, columns), whose cells have a side of ``cell`` metres.

    A part has one value, whatever number of cells it holds, and one common error. Where nothing has grown, every cell
    is a part. No array is made of that: what methods give back is then what they were given, a view or a slice.

    Where cells are ``listed``, arrays of cells are (n,) instead of (rows, columns), and indices of cells are places in
    the list (see ``Layout``).

    Attributes:
        block: the part of each cell; a cell in none has no value. None: nothing has grown.
        side: (parts,) metres: of the square that each part was made from, all of which need not be its own.
        listed: (n,) flat indices of the cells that arrays hold; None: all.
    """

    shape: tuple[int, int]
    cell: float
    block: Parts | None = None
    side: Float | None = None
    listed: Index | None = None

    @classmethod
    def of_blocks(cls, block: Parts, cell: float, side: Float | None = None) -> Partition:
        """Of cells that grew. Without ``side``, that of the smallest square with as many cells as the part has."""
        partition = cls((block.shape[0], block.shape[1]), cell, block, side)
        return partition if side is not None else replace(partition, side=cell * partition.width.astype(np.float64))

    @property
    def grown(self) -> bool:
        return self.block is not None

    @property
    def layout(self) -> Layout:
        """How arrays hold the cells."""
        return Layout(self.shape, self.listed)

    def whole(self) -> Partition:
        """It with arrays (rows, columns)."""
        block = None if self.block is None else self.layout.on_grid(self.block, -1)
        return Partition(self.shape, self.cell, block, self.side)

    @property
    def count(self) -> int:
        """How many parts there are; in a window of a grid, those of the whole."""
        return math.prod(self.layout.array_shape) if self.block is None else self._count(self.block)

    @property
    def number(self) -> Parts:
        """The part of each cell (rows, columns), -1 for none."""
        return np.arange(self.count).reshape(self.layout.array_shape) if self.block is None else self.block

    @property
    def sizes(self) -> Float:
        """``side`` of each cell's part (rows, columns); NaN for none. Read only."""
        if self.side is None:
            return np.broadcast_to(np.float64(self.cell), self.layout.array_shape)
        return self.of_cells(self.side)

    @property
    def cells(self) -> Index:
        """(parts,) how many cells each has. Read only."""
        return np.broadcast_to(np.int64(1), (self.count,)) if self.block is None else self._cells

    @property
    def width(self) -> NDArray[np.int32]:
        """(parts,) side in cells, a power of two: that of the smallest square with as many cells. Read only.

        A block is a square, or what finer ones left of one, which may then count as smaller.
        """
        return np.broadcast_to(np.int32(1), (self.count,)) if self.block is None else self._width

    def of_cells(self, values: NDArray[Any], empty: Any = np.nan) -> NDArray[Any]:
        """``values`` (parts,) on the cells (rows, columns); ``empty`` where there is no part."""
        if self.block is None:
            return values.reshape(self.layout.array_shape)
        full = np.full(self.block.shape, empty, dtype=np.result_type(values, type(empty)))
        inside = self.block >= 0
        full[inside] = values[self.block[inside]]
        return full

    def within(self, cells: Bool) -> Bool:
        """Those of ``cells`` (rows, columns) that are in a part."""
        return cells if self.block is None else cells & (self.block >= 0)

    def one_each(self, cells: Bool) -> Bool:
        """Those of ``cells`` (rows, columns) that are the first of their part, and stand for all of it."""
        return cells if self.block is None else self._only(self._first, cells)

    def middles(self, cells: Bool) -> Bool:
        """Those of ``cells`` (rows, columns) that are nearest to the middle of their part, one each."""
        return cells if self.block is None else self._only(self.middle, cells)

    def first_among(self, here: Index) -> Bool | slice:
        """Which of the cells ``here`` (n,), indices in parts, come first of their part; a slice for all."""
        if self.block is None:
            return slice(None)
        first = np.zeros(here.size, dtype=bool)
        first[np.unique(self.block.ravel()[here], return_index=True)[1]] = True
        return first

    def apart(self, here: Index, one: Index, other: Index) -> Bool | slice:
        """Which pairs ``one`` and ``other`` (m,) of the cells ``here`` (n,) are in two parts; a slice for all."""
        if self.block is None:
            return slice(None)
        number = self.block.ravel().take(here)
        return np.asarray(number[one] != number[other])

    def parts_among(self, cells: Bool) -> int:
        """How many parts have one of ``cells`` (rows, columns)."""
        if self.block is None:
            return int(np.count_nonzero(cells))
        found = np.zeros(self.count, dtype=bool)
        found[self.block[self.within(cells)]] = True
        return int(np.count_nonzero(found))

    def parts_in_groups(self, labels: NDArray[np.integer], count: int) -> Index:
        """(count,) how many parts have a cell in each of the groups 1 to ``count`` of ``labels`` (rows, columns)."""
        if self.block is None:
            return np.bincount(labels.ravel(), minlength=count + 1)[1:]
        inside = np.flatnonzero(self.within(labels > 0))
        pairs = np.unique(np.stack([labels.ravel()[inside], self.block.ravel()[inside]]).astype(np.int64), axis=1)
        return np.bincount(pairs[0], minlength=count + 1)[1:]

    def gathered(self, values: Float, cells: Bool) -> Float:
        """``values`` (rows, columns), those of each part's ``cells`` summed up in the first of these."""
        if self.block is None:
            return values
        inside = np.flatnonzero(self.within(cells))
        _, first, group = np.unique(self.block.ravel()[inside], return_index=True, return_inverse=True)
        gathered = values.copy()
        gathered.ravel()[inside] = 0.0
        gathered.ravel()[inside[first]] = np.bincount(group, values.ravel()[inside])
        return gathered

    def window(self, window: Window) -> Partition:
        """Some rows and columns of it; parts keep their numbers."""
        rows, columns = (len(range(*part.indices(size))) for part, size in zip(window, self.shape, strict=True))
        block = None if self.block is None else self.layout.window(self.block, window, -1)
        return Partition((rows, columns), self.cell, block, self.side)

    @cached_property
    def middle(self) -> Index:
        """(parts,) index of the cell of each that is nearest to the middle of its cells, of equals the first; -1
        for a part without a cell.
        """
        if self.block is None:
            return np.arange(self.count)
        inside = np.flatnonzero(self.block.ravel() >= 0)
        number = self.block.ravel()[inside]
        row, column = self.layout.row_and_column(inside)
        cells = np.maximum(self._cells, 1)
        means = [np.bincount(number, place, minlength=self.count) / cells for place in (row, column)]
        away = np.hypot(row - means[0][number], column - means[1][number])
        order = np.lexsort((inside, np.round(away, 6), number))
        found, first = np.unique(number[order], return_index=True)
        return self._placed(found, inside[order][first])

    @cached_property
    def _first(self) -> Index:
        """(parts,) index of the first cell of each."""
        assert self.block is not None
        inside = np.flatnonzero(self.block.ravel() >= 0)[::-1]
        # of a part's cells, that which is written last stays
        return self._placed(self.block.ravel()[inside], inside)

    @cached_property
    def _cells(self) -> Index:
        assert self.block is not None
        return np.bincount(self.block[self.block >= 0], minlength=self._count(self.block))

    @cached_property
    def _width(self) -> NDArray[np.int32]:
        return 2 ** np.ceil(np.log2(np.maximum(self._cells, 1)) / 2 - 1e-9).astype(np.int32)

    def _count(self, block: Parts) -> int:
        return int(block.max(initial=-1)) + 1 if self.side is None else self.side.size

    def _placed(self, number: Parts, cell: Index) -> Index:
        placed = np.full(self.count, -1, dtype=np.int64)
        placed[number] = cell
        return placed

    def _only(self, of_parts: Index, cells: Bool) -> Bool:
        chosen = of_parts[of_parts >= 0]
        only = np.zeros(cells.shape, dtype=bool)
        only.ravel()[chosen] = cells.ravel()[chosen]
        return only
