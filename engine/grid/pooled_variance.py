"""Variance of a point in each cell, where few points determine it poorly."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float
from ..statistics.window_sums import Windows
from .cell_statistics import CellStatistics

# Degrees of freedom that the neighbourhood's variance counts in addition to the cell's own (see pooled_variance).
_PRIOR_DEGREES = 8.0


def pooled_variance(cells: CellStatistics, *, radius: int = 5) -> Float:
    """Variance of a point in each cell that has any, (cells,), moderated by its neighbourhood.

    The variance from two or three points is nearly worthless: small by chance, it would make noise significant. So the
    pooled variance of the cells within ``radius`` counts as a prior with ``_PRIOR_DEGREES`` degrees of freedom
    (moderated variance, Smyth 2004, doi:10.2202/1544-6115.1027, eq. 5).
    """
    # a plane's residuals do not hold the cell's slope, a mean's do: each kind learns from its own
    pooled = _moderated(cells.scatter, cells.points.astype(np.float64) - 1.0, Windows(cells.cell, cells.shape, radius))
    tilted = cells.tilted
    if tilted.any():
        windows = Windows(cells.cell[tilted], cells.shape, radius)
        pooled[tilted] = _moderated(cells.variance[tilted], cells.degrees[tilted], windows)
    return pooled


def _moderated(own: Float, degrees: Float, windows: Windows) -> Float:
    """Variances ``own`` with ``degrees`` of freedom each, pulled to the pooled one of those in the same windows."""
    squares = np.where(degrees > 0, own * degrees, 0.0)
    whole = squares.sum() / max(degrees.sum(), 1.0)
    around, free = windows.totals(windows.cell, squares, degrees.astype(np.int32))
    prior = np.where(free > 0, around / np.maximum(free, 1), whole)
    return (squares + _PRIOR_DEGREES * prior) / (degrees + _PRIOR_DEGREES)
