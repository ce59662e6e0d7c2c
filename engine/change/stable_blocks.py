"""Cells of a difference that did not change, where cells grew: what ``stable_cells`` does, block by block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Float
from ..grid.blocks import Blocks, block_sides, sums_around
from .stable_cells import BEYOND, REACH, ROUNDS, adjacent_scatter, clipped, with_alike

_WINDOW = 3  # of a block's own sides, at least: it and its neighbours


def find_stable_blocks(
    dz: Float, error: Float, slope: Float, cell: float, block: Blocks, alike: Float | None = None
) -> NDArray[np.bool_]:
    """Cells (rows, columns) of blocks that are not part of a coherent change, nor beside one.

    As ``stable_cells.find_stable``, with windows as wide as there, or that hold a block and its neighbours where it is
    more; each block in them counts as one.

    Args:
        dz: change, metres, one for all cells of a block; NaN where unknown.
        error: its standard error before calibration, metres.
        slope: degrees; NaN where unknown.
        cell: side of a cell, metres.
        block: number of each cell's block, -1 for none.
        alike: (rows, columns) an error beside it that neighbours share, metres: it does not average out in a mean.
    """
    known = np.isfinite(dz) & np.isfinite(error) & (error > 0) & (block >= 0)
    if not known.any():
        return known
    scaled = dz[known] / error[known]
    scatter_of_one = adjacent_scatter(scaled, np.flatnonzero(known), slope, block)
    scaled = scaled / scatter_of_one
    z, least = np.zeros(dz.shape), 2 * round(REACH / cell) + 1
    of_cells: Float | float = 0.0
    if alike is None:
        number = sums_around(known, block, _WINDOW, least)[known]
    else:
        scaled, of_cells = with_alike(scaled, alike[known] / (error[known] * scatter_of_one))
        shared, own = np.zeros(dz.shape), np.zeros(dz.shape)
        shared[known], own[known] = of_cells, 1.0 - of_cells**2
        number = sums_around(own, block, _WINDOW, least)[known]
        number += sums_around(shared, block, _WINDOW, least)[known] ** 2
    z[known] = clipped(scaled, of_cells)
    total = sums_around(z, block, _WINDOW, least)[known]
    moved = z
    moved[known] = np.abs(total) / np.sqrt(np.maximum(number, 1.0))
    side = block_sides(block)
    stable = known
    for _ in range(ROUNDS):
        one_each = np.unique(block[stable], return_index=True)[1]
        scatter = max(1.0, 1.4826 * float(np.median(moved[stable][one_each])))
        centres = known & (moved > BEYOND * scatter)
        left = known.copy()
        for multiple in np.unique(side[centres]):
            size = max(2 * int(multiple) + 1, least)
            left &= ~ndimage.maximum_filter(centres & (side == multiple), size=size)
        # a block is stable as a whole or not at all
        touched = np.zeros(int(block.max()) + 1, dtype=bool)
        touched[block[known & ~left]] = True
        left &= ~touched[np.maximum(block, 0)]
        if not left.any() or np.array_equal(left, stable):
            return left
        stable = left
    return stable
