"""How much of the ground two epochs have in common, and what larger cells would compare."""

from __future__ import annotations

import math

import numpy as np

from .result import Change

_MIN_COMMON_SHARE = 0.8
_BLOCK_M = 1.0  # side of the blocks, m, at least, that an epoch reached with any point


def common_rate_at(change: Change, multiple: int) -> float:
    """Share of common cells, were the cells ``multiple`` times as large."""
    least = max(int(change.minimum_points), 1)
    common, either = (
        combine(*(change.layout.block_sums(count, multiple) >= least for count in change.points))
        for combine in (np.logical_and, np.logical_or)
    )
    return float(common.sum() / max(either.sum(), 1))


def cell_that_compares(change: Change) -> float | None:
    """The smallest multiple of the cell with which 80 % of the cells or more would be common; None: there is none."""
    for multiple in (2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 50):
        if multiple >= max(change.grid.shape):
            break
        if common_rate_at(change, multiple) >= _MIN_COMMON_SHARE:
            return round(multiple * change.grid.cell, 6)
    return None


def compared_share(change: Change, *, both: bool = False) -> float:
    """Area of the common cells over the area that either epoch, or ``both``, reached, in blocks of a metre or more."""
    multiple = max(1, math.ceil(_BLOCK_M / change.grid.cell - 1e-9))
    first, second = (change.layout.block_sums(count, multiple) > 0 for count in change.points)
    reached = first & second if both else first | second
    return min(1.0, float(change.valid.sum() / max(int(reached.sum()) * multiple**2, 1)))
