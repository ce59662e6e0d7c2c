"""Points in squares seen from above, by number."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Bool, Float, Index
from ..geometry.columns import least


def square_numbers(points: Float, side: float, origin: Float | None = None) -> Index:
    """(n,) number of the square of ``side`` metres that each of the points (n, 2+) lies in.

    Squares begin at ``origin`` (2+,), of which no coordinate is larger than the points'; by default at their lowest.
    """
    low = lowest_corner(points, origin)
    column, row = (np.floor((points[:, axis] - low[axis]) / side).astype(np.int64) for axis in (0, 1))
    return np.asarray(column * (int(row.max()) + 1) + row, dtype=np.int64)


def lowest_corner(points: Float, origin: Float | None = None) -> Float:
    """(2,) where squares over points (n, 2+) begin: at ``origin`` (2+,), by default at the points' lowest."""
    return np.asarray(least(points[:, :2]) if origin is None else origin[:2], dtype=np.float64)


def first_of_runs(number: Index) -> Bool:
    """(n,) the first of each run of equal numbers."""
    first = np.ones(len(number), dtype=bool)
    first[1:] = number[1:] != number[:-1]
    return first
