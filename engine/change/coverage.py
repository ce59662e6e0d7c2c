"""How much of the ground two epochs have in common, and what larger cells would compare."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool
from ..grid.growing_cells import surveyed
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


@dataclass(frozen=True)
class GroundCompared:
    """Ground within the outline of two surveys, m², and how much of it was compared.

    Attributes:
        compared: area with a change.
        only_first, only_second: within the outline of one survey alone.
        too_few: the rest, where both surveys have too few points for a change.
    """

    compared: float
    only_first: float
    only_second: float
    too_few: float

    @property
    def share(self) -> float:
        """Of the ground within the outline of either survey."""
        return self.compared / max(self.compared + self.only_first + self.only_second + self.too_few, 1e-9)


def ground_compared(change: Change) -> GroundCompared:
    """What of the ground was compared, and why the rest was not."""
    first, second, ground = _outlines(change)
    valid, area = change.layout.on_grid(change.valid), change.grid.cell**2
    missing = ground & ~valid

    def of(cells: Bool) -> float:
        return float(np.count_nonzero(cells)) * area

    one, other = missing & first & ~second, missing & second & ~first
    return GroundCompared(of(valid), of(one), of(other), of(missing & ~one & ~other))


def not_compared(change: Change) -> Bool:
    """Cells (rows, columns) of ground without a change."""
    return np.asarray(_outlines(change)[2] & ~change.layout.on_grid(change.valid))


def _outlines(change: Change) -> tuple[Bool, Bool, Bool]:
    """Cells within the outline of the first survey, of the second, and all ground with the holes in both."""
    reach, layout = max(1, round(_BLOCK_M / change.grid.cell)), change.layout
    first, second = (surveyed(layout.on_grid(count) > 0, int(count.sum()), reach) for count in change.points)
    return first, second, ndimage.binary_fill_holes(first | second | layout.on_grid(change.valid))


def compared_share(change: Change, *, both: bool = False) -> float:
    """Area of the common cells over the area that either epoch, or ``both``, reached, in blocks of a metre or more."""
    multiple = max(1, math.ceil(_BLOCK_M / change.grid.cell - 1e-9))
    first, second = (change.layout.block_sums(count, multiple) > 0 for count in change.points)
    reached = first & second if both else first | second
    return min(1.0, float(change.valid.sum() / max(int(reached.sum()) * multiple**2, 1)))
