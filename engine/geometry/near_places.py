"""Which points lie near to places, seen from above."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from .columns import greatest, least

SQUARES_A_REACH = 1.5
"""More than the root of two, so that points of one square are near; at most two, so that two squares around suffice."""


def near_places(places: Float, points: Float, reach: float) -> Bool:
    """(n,) which points (n, 2 or more) lie within ``reach`` m of one of the places (m, 2 or more), seen from above.

    A point in the square of a place is near. Distances are taken only of the others that have one in a square around.
    """
    if not len(places):
        return np.zeros(len(points), dtype=np.bool_)
    side, low = reach / SQUARES_A_REACH, least(places[:, :2])
    square = np.floor((places[:, :2] - low) / side).astype(np.int64) + 2
    holds = np.zeros(greatest(square) + 3, dtype=bool)
    holds[tuple(square.T)] = True
    about = ndimage.binary_dilation(holds, np.ones((5, 5)))
    place = np.clip(np.floor((points[:, :2] - low) / side) + 2, 0, np.array(holds.shape) - 1).astype(np.int64).T
    near = holds[tuple(place)]
    rest = np.flatnonzero(about[tuple(place)] & ~near)
    distance, _ = cKDTree(places[:, :2]).query(points[rest, :2], distance_upper_bound=reach)
    near[rest] = distance <= reach
    return np.asarray(near, dtype=np.bool_)
