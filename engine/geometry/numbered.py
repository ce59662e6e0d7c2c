"""Points that have numbers, as of the cells that they lie in: which numbers there are, the lowest point of each.

Numbers that lie as close as those of a grid's cells are counted instead of sorted, which takes a fortieth of the time.
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float, Index

MAX_EXTENT_POINTS, MAX_SMALL_EXTENT = 4, 1_000_000
"""Numbers are counted up to so many possible ones for each point, and so many more; else memory would be wasted."""


def distinct(numbers: Index) -> tuple[Index, Index, Index]:
    """The different ones of ``numbers`` (n,), ascending; (n,) the place of each number among them, and their counts."""
    if not len(numbers):
        return (np.zeros(0, dtype=np.int64),) * 3
    low, extent = _extent(numbers)
    if extent > MAX_EXTENT_POINTS * len(numbers) + MAX_SMALL_EXTENT:
        found, place, counts = np.unique(numbers, return_inverse=True, return_counts=True)
        return found, place.ravel(), counts
    every = np.bincount(numbers - low, minlength=extent)
    held = every > 0
    return np.flatnonzero(held) + low, (np.cumsum(held) - 1)[numbers - low], every[held]


def united(*numbers: Index) -> Index:
    """The different ones of several arrays (n,) of numbers, ascending."""
    every = [each for each in numbers if len(each)]
    if not every:
        return np.zeros(0, dtype=np.int64)
    low = min(int(each.min()) for each in every)
    extent = max(int(each.max()) for each in every) - low + 1
    if extent > MAX_EXTENT_POINTS * sum(len(each) for each in every) + MAX_SMALL_EXTENT:
        return np.unique(np.concatenate(every))
    held = np.zeros(extent, dtype=bool)
    for each in every:
        held[each - low] = True
    return np.flatnonzero(held) + low


def counts_of_each(numbers: Index) -> Index:
    """How many there are of each of the different ``numbers`` (n,), these ascending."""
    if not len(numbers):
        return np.zeros(0, dtype=np.int64)
    low, extent = _extent(numbers)
    if extent > MAX_EXTENT_POINTS * len(numbers) + MAX_SMALL_EXTENT:
        return distinct(numbers)[2]
    counts = np.bincount(numbers - low if low else numbers, minlength=extent)
    return counts[counts > 0]


def _extent(numbers: Index) -> tuple[int, int]:
    """The least of the numbers, and how many there may be from it to the largest."""
    low = int(numbers.min())
    return low, int(numbers.max()) - low + 1


def lowest_heights(place: Index, height: Float, count: int) -> Float:
    """(count,) least ``height`` (n,) at each ``place`` (n,), as of ``distinct``."""
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, place, height)
    return lowest


def lowest_of_each(numbers: Index, height: Float) -> Index:
    """Index of the lowest point of each of the different ``numbers`` (n,), these ascending; of equal ones the first."""
    found, place, _ = distinct(numbers)
    tied = np.flatnonzero(height == lowest_heights(place, height, len(found))[place])[::-1]
    lowest = np.empty(len(found), dtype=np.int64)
    # of points at one place the last that is assigned stays
    lowest[place[tied]] = tied
    return lowest
