"""How far the points of a cloud are apart."""

from __future__ import annotations

import math

import numpy as np

from ..core.arrays import Float, Index
from .columns import greatest, least
from .numbered import counts_of_each


def point_spacing(xy: Float) -> float:
    """Mean spacing (m) of points (n, 2) seen from above: the root of the median area a point has in occupied cells."""
    low = least(xy)
    extent = float((greatest(xy) - low).max())
    cell = 1.0
    while True:
        column, row = (np.floor((xy[:, axis] - low[axis]) / cell).astype(np.int64) for axis in (0, 1))
        counts = counts_of_each(column * (int(row.max()) + 1) + row)
        density = float(np.median(counts))
        # cells of a point or two do not show the gaps between them
        if density >= 8 or cell >= extent:
            return cell / math.sqrt(density)
        cell *= 2.0


def spacing_from_counts(places: Index, counts: Index, extent: float) -> float:
    """``point_spacing`` of points counted in squares of a metre that begin at their lowest coordinates.

    Args:
        places: (n, 2) column and row of each square that holds points.
        extent: of the points, the longer side, metres.
    """
    cell = 1
    while True:
        keys = places // cell
        _, square = np.unique(keys[:, 0] * (int(keys[:, 1].max()) + 1) + keys[:, 1], return_inverse=True)
        density = float(np.median(np.bincount(square.ravel(), counts)))
        if density >= 8 or cell >= extent:
            return cell / math.sqrt(density)
        cell *= 2


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
