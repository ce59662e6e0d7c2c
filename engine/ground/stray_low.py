"""Stray returns below a surface: multipath, whose pulse took a longer way than the straight one.

They lie at any depth and make no sheet. The ground, even where plants let few pulses through, is a sheet: within a few
square metres its returns have one height. So returns are counted in slices of squares, and a slice with a small part of
the returns of a slice above it is stray, if nothing fuller lies below. Only clouds with a noteworthy share of such
returns should be treated: elsewhere these may be sparse ground under dense plants, and single strays do no harm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Bool, Float, Index
from ..core.compiled import compiled
from ..geometry.numbered import distinct
from .squares import first_of_runs, lowest_corner

SQUARE_M, REACH_SQUARES = 0.5, 2
"""Side of the squares, and how many on each side are counted together: 2.5 m, in which few hits of ground add up."""
MAX_STRAY_SHARE = 0.06
"""Share of the returns of the fullest slice above, below which a slice is stray: of 5 % multipath a slice of 0.2 m
holds up to 1.5 %, and the ground under simulated closed grass is never that empty."""
MIN_RETURNS_ABOVE = 12.0
"""Returns in the fullest slice above, below which no slice is stray: single hits of ground under trees are none."""
MIN_REPORTED_SHARE = 0.003
"""Share of stray returns in the cloud from which they are taken out."""


def stray_below(xyz: Float, slice_m: float, origin: Float | None = None) -> Bool:
    """Which returns (n,) lie below the ground, in slices far emptier than one above.

    Args:
        xyz: (n, 3) metres, in a frame in which the slope lies flat.
        slice_m: thickness of the slices; two count together.
        origin: (2+,) where the squares begin, see ``square_numbers``.
    """
    if len(xyz) == 0:
        return np.zeros(0, dtype=bool)
    column = np.floor((xyz[:, :2] - lowest_corner(xyz, origin)) / SQUARE_M).astype(np.int64) + REACH_SQUARES
    level = np.floor((xyz[:, 2] - xyz[:, 2].min()) / slice_m).astype(np.int64)
    levels, width = int(level.max()) + 2, int(column[:, 1].max()) + REACH_SQUARES + 1
    key, voxel, counts = distinct((column[:, 0] * width + column[:, 1]) * levels + level)
    pooled = pooled_counts(key, counts, width, levels)
    place, height = key // levels, key % levels
    fullest = _fullest_above(place, height, pooled, width)
    empty = (pooled < MAX_STRAY_SHARE * fullest) & (fullest >= MIN_RETURNS_ABOVE)
    rank = np.cumsum(np.concatenate([[0], np.diff(place) != 0]))
    # below a wall or a crown there is ground; below strays there is nothing
    nothing_below = _running_maximum((~empty).astype(np.float64), rank) == 0
    return np.asarray((empty & nothing_below)[voxel], dtype=np.bool_)


def _fullest_above(place: Index, height: Index, pooled: Float, width: int) -> Float:
    """(v,) the largest of ``pooled`` (v,) among the fullest voxels of the columns around that lie above each voxel.

    Args:
        place, height: (v,) column and level of each voxel, sorted by both; a row of columns has ``width``.
    """
    rank = np.cumsum(np.concatenate([[0], np.diff(place) != 0]))
    own = _running_maximum(pooled[::-1], rank[-1] - rank[::-1])[::-1]
    found = own.copy()
    # a beam that leaves its column on its way down has no ground above it: look in the adjacent columns
    lonely = np.flatnonzero(own < MIN_RETURNS_ABOVE)
    order = np.lexsort((-pooled, place))
    best = order[first_of_runs(place[order])]
    columns, level, value = place[best], height[best], pooled[best]
    for across in range(-REACH_SQUARES, REACH_SQUARES + 1):
        for along in range(-REACH_SQUARES, REACH_SQUARES + 1):
            neighbour = place[lonely] + across * width + along
            index = np.minimum(np.searchsorted(columns, neighbour), len(columns) - 1)
            above = (columns[index] == neighbour) & (level[index] > height[lonely])
            found[lonely] = np.maximum(found[lonely], np.where(above, value[index], 0.0))
    return found


def _running_maximum(values: Float, group: NDArray[np.int64]) -> Float:
    """Largest of ``values`` (v,) so far in each group; ``group`` (v,) counts upwards."""
    # each group is lifted over those before, so that the maximum starts anew with it
    lift = (float(values.max()) + 1.0) * group
    return np.asarray(np.maximum.accumulate(values + lift) - lift, dtype=np.float64)


def _pooled_counts_by_numpy(key: Index, counts: Index, width: int, levels: int) -> Float:
    total = np.concatenate([[0], np.cumsum(counts)])
    pooled = np.zeros(len(key))
    for across in range(-REACH_SQUARES, REACH_SQUARES + 1):
        for along in range(-REACH_SQUARES, REACH_SQUARES + 1):
            start = key + (across * width + along) * levels
            pooled += total[np.searchsorted(key, start + 2)] - total[np.searchsorted(key, start)]
    return pooled


@compiled(_pooled_counts_by_numpy)
def pooled_counts(key: Index, counts: Index, width: int, levels: int) -> Float:
    """(v,) returns in each voxel, the one above it, and those of the columns within REACH_SQUARES.

    Args:
        key: (v,) numbers of the voxels with returns, ascending: column by column upwards, ``levels`` in each column,
            ``width`` columns in a row.
        counts: (v,) returns in each voxel.
    """
    pooled = np.zeros(len(key))
    for across in range(-REACH_SQUARES, REACH_SQUARES + 1):
        for along in range(-REACH_SQUARES, REACH_SQUARES + 1):
            shift = (across * width + along) * levels
            # both ends of what is summed only move on, as the voxels are in order
            first, end, held = 0, 0, 0
            for i in range(len(key)):
                start = key[i] + shift
                while end < len(key) and key[end] < start + 2:
                    held += counts[end]
                    end += 1
                while first < end and key[first] < start:
                    held -= counts[first]
                    first += 1
                pooled[i] += held
    return pooled
