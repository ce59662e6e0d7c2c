"""Variance of a point in each cell, where few points tell little of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .gridding import CellStatistics, Float
from .window_sums import RunningSums, fixed_point, windows_around

# Degrees of freedom that the neighbourhood's variance counts beside the cell's own (see pooled_variance).
_PRIOR_DEGREES = 8.0


def pooled_variance(cells: CellStatistics, *, radius: int = 5) -> Float:
    """Variance of a point in each cell, moderated by its neighbourhood; NaN in cells without points.

    The variance from two or three points is nearly worthless: small by chance, it would make noise significant. So the
    pooled variance of the cells within ``radius`` counts as a prior with ``_PRIOR_DEGREES`` degrees of freedom
    (moderated variance, Smyth 2004, doi:10.2202/1544-6115.1027, eq. 5).
    """
    # a plane's residuals do not hold the cell's slope, a mean's do: each kind learns from its own
    pooled = _moderated(cells.scatter, np.maximum(cells.count - 1, 0), radius, cells.count > 0)
    if cells.tilted.any():
        fitted = np.where(cells.tilted, cells.degrees, 0.0).astype(np.int64)
        pooled[cells.tilted] = _moderated(cells.variance, fitted, radius, cells.tilted)[cells.tilted]
    return pooled


def _moderated(own: Float, degrees: NDArray[np.int64], radius: int, where: NDArray[np.bool_]) -> Float:
    """Variance with ``degrees`` of freedom a cell, pulled to the pooled one of the cells within ``radius``."""
    squares = np.nan_to_num(own) * degrees
    whole = squares.sum() / max(int(degrees.sum()), 1)
    row, column = np.nonzero(where)
    units, unit = fixed_point(squares, float(squares.sum()))
    sums = RunningSums([units, degrees]).totals(windows_around(row, column, radius, own.shape))
    prior = np.where(sums[1] > 0, sums[0] * unit / np.maximum(sums[1], 1), whole)
    moderated = np.full(own.shape, np.nan)
    moderated[row, column] = (squares[row, column] + _PRIOR_DEGREES * prior) / (degrees[row, column] + _PRIOR_DEGREES)
    return moderated
