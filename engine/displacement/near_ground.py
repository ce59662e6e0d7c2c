"""Which places of a grid have a point near them, in a loop that numba compiles, and by a tree with the same result."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from ..core.compiled import compiled


def _near_by_tree(xyz: Float, x: Float, y: Float, reach: float) -> Bool:
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    apart = cKDTree(xyz[:, :2]).query(places, distance_upper_bound=reach)[0]
    return np.asarray(np.isfinite(apart).reshape(len(y), len(x)))


@compiled(_near_by_tree)
def near_points(xyz: Float, x: Float, y: Float, reach: float) -> Bool:
    """(rows, columns) whether a point (n, 3) lies nearer than ``reach`` to each place, seen from above, metres.

    Args:
        x: (columns,) of the places, ascending and evenly spaced.
        y: (rows,) of the places, descending and evenly spaced.
    """
    rows, columns = len(y), len(x)
    found = np.zeros((rows, columns), dtype=np.bool_)
    across = x[1] - x[0] if columns > 1 else 1.0
    down = y[0] - y[1] if rows > 1 else 1.0
    for n in range(len(xyz)):
        east, north = xyz[n, 0], xyz[n, 1]
        # one place more on each side, so that no rounding leaves one out
        left, right = math.floor((east - reach - x[0]) / across) - 1, math.ceil((east + reach - x[0]) / across) + 1
        top, bottom = math.floor((y[0] - north - reach) / down) - 1, math.ceil((y[0] - north + reach) / down) + 1
        for i in range(max(top, 0), min(bottom, rows - 1) + 1):
            for j in range(max(left, 0), min(right, columns - 1) + 1):
                if found[i, j]:
                    continue
                dx, dy = x[j] - east, y[i] - north
                found[i, j] = dx * dx + dy * dy < reach * reach
    return found
