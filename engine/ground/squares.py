"""Points in squares seen from above, by number."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Bool, Float, Index


def square_numbers(points: Float, side: float, origin: Float | None = None) -> Index:
    """(n,) number of the square of ``side`` metres that each of the points (n, 2+) lies in.

    Squares begin at ``origin`` (2+,), of which no coordinate is larger than the points'; by default at their lowest.
    """
    place = np.floor((points[:, :2] - lowest_corner(points, origin)) / side).astype(np.int64)
    return np.asarray(place[:, 0] * (int(place[:, 1].max()) + 1) + place[:, 1], dtype=np.int64)


def lowest_corner(points: Float, origin: Float | None = None) -> Float:
    """(2,) where squares over points (n, 2+) begin: at ``origin`` (2+,), by default at the points' lowest."""
    return np.asarray(points[:, :2].min(axis=0) if origin is None else origin[:2], dtype=np.float64)


def first_of_runs(number: Index) -> Bool:
    """(n,) the first of each run of equal numbers."""
    first = np.ones(len(number), dtype=bool)
    first[1:] = number[1:] != number[:-1]
    return first
