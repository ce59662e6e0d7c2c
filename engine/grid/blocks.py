"""Cells that are one: what to do with the cells of a grown block where each should count, or err, once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Float

Blocks = NDArray[np.signedinteger[Any]]
"""Number of each cell's block (rows, columns); -1 where there is none."""


_BAND = 4_000_000  # cells that are summed around at a time


def middle_cells(block: Blocks) -> NDArray[np.bool_]:
    """One cell of each block (rows, columns): that nearest to the middle of its cells."""
    inside = np.flatnonzero(block.ravel() >= 0)
    number = block.ravel()[inside]
    row, column = np.divmod(inside, block.shape[1])
    cells = np.maximum(np.bincount(number), 1)
    away = np.hypot(
        row - (np.bincount(number, row) / cells)[number], column - (np.bincount(number, column) / cells)[number]
    )
    # the nearest first, of equals the first in the order of the cells
    order = np.lexsort((inside, np.round(away, 6), number))
    first = np.unique(number[order], return_index=True)[1]
    found = np.zeros(block.size, dtype=bool)
    found[inside[order][first]] = True
    return found.reshape(block.shape)


def blocks_in_groups(labels: NDArray[np.integer], block: Blocks, count: int) -> NDArray[np.int64]:
    """How many blocks have a cell in each group (``labels`` 0 to ``count``), cells outside of blocks one each."""
    inside = np.flatnonzero(labels.ravel() > 0)
    number = block.ravel()[inside]
    # numbers of their own for cells outside of blocks
    number = np.where(number >= 0, number, block.max(initial=-1) + 1 + inside)
    pairs = np.unique(np.stack([labels.ravel()[inside].astype(np.int64), number]), axis=1)
    return np.bincount(pairs[0], minlength=count + 1)


def first_cells(block: Blocks) -> NDArray[np.bool_]:
    """The first cell (rows, columns) of each block, which stands for all of it."""
    inside = np.flatnonzero(block.ravel() >= 0)
    first = np.zeros(block.size, dtype=bool)
    first[inside[np.unique(block.ravel()[inside], return_index=True)[1]]] = True
    return first.reshape(block.shape)


def block_sides(block: Blocks) -> NDArray[np.int32]:
    """Side of each cell's block in cells, a power of two, 0 for none: that of the smallest square with as many cells.

    A block is a square, or what finer blocks left of one, which may then count as smaller.
    """
    inside = block >= 0
    number = block[inside]
    side = 2 ** np.ceil(np.log2(np.maximum(np.bincount(number), 1)) / 2 - 1e-9).astype(np.int32)
    sides = np.zeros(block.shape, dtype=np.int32)
    sides[inside] = side[number]
    return sides


def sums_around(values: NDArray, block: Blocks, window: int, least: int = 1) -> Float:
    """Sum over the blocks around each cell's block, in a window of ``window`` of its own sides or ``least`` cells.

    A block counts with the mean of its cells' ``values`` (or with 1 for True), times the part of its cells that is in
    the window. The window lies around the block's middle cell; its own block is in it. Cells outside of blocks get and
    count nothing.
    """
    inside = block >= 0
    number = block[inside]
    cells = np.bincount(number)
    weight = np.zeros(block.shape)
    weight[inside] = values[inside] / cells[number]
    side = block_sides(block)
    middle = middle_cells(block)
    result = np.zeros(cells.shape)
    for multiple in np.unique(side[inside]):
        reach = max(2 * (window * int(multiple) // 2) + 1, least)
        row, column = np.nonzero(middle & (side == multiple))
        result[block[row, column]] = _sums_at(weight, reach, row, column)
    around = np.zeros(block.shape)
    around[inside] = result[number]
    return around


def _sums_at(weight: Float, reach: int, row: NDArray[np.int64], column: NDArray[np.int64]) -> Float:
    """Sums over the windows of ``reach`` cells around the places (n,), in rows' order, where these are only."""
    if weight.size <= _BAND:
        whole: Float = ndimage.uniform_filter(weight, reach, mode="constant")[row, column] * reach**2
        return whole
    sums = np.empty(row.size)
    height = max(_BAND // weight.shape[1], 2 * reach)
    for top in range(0, weight.shape[0], height):
        here = slice(*np.searchsorted(row, (top, top + height)).tolist())
        if here.start == here.stop:
            continue
        first = max(top - reach, 0), max(int(column[here].min()) - reach, 0)
        last = top + height + reach, int(column[here].max()) + reach + 1
        part = weight[first[0] : last[0], first[1] : last[1]]
        total = ndimage.uniform_filter(part, reach, mode="constant") * reach**2
        sums[here] = total[row[here] - first[0], column[here] - first[1]]
    return sums
