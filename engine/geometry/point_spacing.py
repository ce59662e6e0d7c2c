"""How far the points of a cloud are apart."""

from __future__ import annotations

import math

import numpy as np

from ..core.arrays import Float, Index

_MOST_SQUARES_A_POINT = 8  # up to so many squares are counted in an array of all; with more the points are sorted


def point_spacing(xy: Float) -> float:
    """Mean spacing (m) of points (n, 2) seen from above: the root of the median area a point has in occupied cells."""
    # by columns: numpy reduces an axis of two far more slowly
    x, y = (axis - axis.min() for axis in (xy[:, 0], xy[:, 1]))
    extent = max(float(x.max()), float(y.max()))
    cell = 1.0
    while True:
        density = float(np.median(_counts(np.floor(x / cell).astype(np.int64), np.floor(y / cell).astype(np.int64))))
        # cells of a point or two do not show the gaps between them
        if density >= 8 or cell >= extent:
            return cell / math.sqrt(density)
        cell *= 2.0


def _counts(column: Index, row: Index) -> Index:
    """How many points lie in each square that holds any."""
    rows = int(row.max()) + 1
    keys = column * rows + row
    if (int(column.max()) + 1) * rows > _MOST_SQUARES_A_POINT * len(keys):
        return np.asarray(np.unique(keys, return_counts=True)[1])
    counts = np.bincount(keys)
    return np.asarray(counts[counts > 0])


def spacing_of_squares(places: Index, counts: Float) -> float:
    """``point_spacing`` of points of which only the numbers (n,) in squares of a metre are known.

    Args:
        places: (n, 2) column and row of each square that holds points, from any origin.
    """
    extent = float(np.ptp(places, axis=0).max()) + 1.0
    cell = 1
    while True:
        keys = places // cell
        keys = keys - keys.min(axis=0)
        _, square = np.unique(keys[:, 0] * (int(keys[:, 1].max()) + 1) + keys[:, 1], return_inverse=True)
        density = float(np.median(np.bincount(square.ravel(), counts)))
        if density >= 8 or cell >= extent:
            return cell / math.sqrt(density)
        cell *= 2
