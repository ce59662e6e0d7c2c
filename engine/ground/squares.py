"""Points in squares seen from above, by number."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Bool, Float, Index


def square_numbers(points: Float, side: float) -> Index:
    """(n,) number of the square of ``side`` metres that each of the points (n, 2+) lies in, from their lowest on."""
    place = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / side).astype(np.int64)
    return np.asarray(place[:, 0] * (int(place[:, 1].max()) + 1) + place[:, 1], dtype=np.int64)


def first_of_runs(number: Index) -> Bool:
    """(n,) the first of each run of equal numbers."""
    first = np.ones(len(number), dtype=bool)
    first[1:] = number[1:] != number[:-1]
    return first
