"""Outliers: small groups of points that stand apart from everything else, below the ground or above the plants.

A count of neighbours in a sphere, the usual test, takes sparse ground under trees for noise, and a search for the
neighbours of every point takes longer than all the rest. Here points share flat boxes that lie along the slope. Boxes
that touch belong together, and only groups of few points are outliers. Ground seen through gaps metres apart stays
connected sideways; a stray echo under it has nothing next to it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..core.arrays import Bool, Float, Index
from ..geometry.columns import largest_sizes
from ..geometry.numbered import MAX_EXTENT_POINTS, MAX_SMALL_EXTENT, distinct
from ..geometry.point_spacing import point_spacing

BOX_WIDTH_RADII, BOX_HEIGHT_RADII = 2.5, 0.5
"""Sides of a box along the slope and across it, in units of the radius."""
MIN_RADIUS_SPACINGS = 3.0
"""The radius is at least so many times the points' spacing."""
_MAX_BOX = 1 << 20
_STRIDES = np.array([1 << 42, 1 << 21, 1], dtype=np.int64)
_MIDDLE_BOX = int(_MAX_BOX * _STRIDES.sum())
"""Number of the box in the middle, where points too far away for a number of their own are counted."""
_NEIGHBOUR_STEPS = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) > (0, 0, 0)]


def outliers(xyz: NDArray[np.float64], radius: float, group: int) -> NDArray[np.bool_]:
    """Points in groups of at most ``group`` that nothing else touches.

    Args:
        xyz: (n, 3) in metres, in a frame in which the slope is roughly level.
        radius: distance (m) across the slope beyond which points are apart; along it five times as much.
        group: largest number of points that are outliers together.

    Returns:
        (n,) bool.
    """
    if len(xyz) == 0:
        return np.zeros(0, dtype=bool)
    middle = np.median(xyz, axis=0)
    # far strays must not make the cloud look sparse
    core = largest_sizes(xyz - middle) <= core_reach(xyz, middle)
    radius = max(radius, MIN_RADIUS_SPACINGS * point_spacing(xyz[core, :2]))
    key = box_numbers(xyz, middle, radius)
    far = key < 0
    occupied, box, counts = _boxes(np.where(far, _MIDDLE_BOX, key))
    return np.asarray(small_groups(occupied, counts, group)[box] | far, dtype=np.bool_)


def _boxes(key: Index) -> tuple[Index, Index, Index]:
    """``distinct`` of the numbers (n,) of boxes, which are far apart from one row of boxes to the next."""
    axes = [(key // stride) % (2 * _MAX_BOX) for stride in _STRIDES.tolist()]
    lows, sizes = zip(*((int(axis.min()), int(np.ptp(axis)) + 1) for axis in axes), strict=True)
    if math.prod(sizes) > MAX_EXTENT_POINTS * len(key) + MAX_SMALL_EXTENT:
        found, place, counts = np.unique(key, return_inverse=True, return_counts=True)
        return found, place.ravel(), counts
    shape = tuple(sizes)
    found, place, counts = distinct(np.ravel_multi_index([a - low for a, low in zip(axes, lows, strict=True)], shape))
    places = np.column_stack(np.unravel_index(found, shape)) + np.array(lows)
    return places @ _STRIDES, place, counts


def core_reach(xyz: Float, middle: Float) -> float:
    """Distance (m) along an axis from the middle (3,) of points (n, 3), within which all but far strays lie."""
    return 20.0 * float(np.median(largest_sizes(xyz - middle))) + 1e-9


def box_numbers(xyz: Float, middle: Float, radius: float) -> Index:
    """(n,) number of the box of each point (n, 3); -1 for points that are too far from the middle (3,) to be counted.

    Args:
        radius: distance (m) across the slope beyond which points are apart.
    """
    boxes = np.floor((xyz - middle) / (np.array([BOX_WIDTH_RADII, BOX_WIDTH_RADII, BOX_HEIGHT_RADII]) * radius))
    far = largest_sizes(boxes) >= _MAX_BOX - 1
    index = np.where(far[:, None], 0, boxes).astype(np.int64) + _MAX_BOX
    return np.where(far, -1, index @ _STRIDES)


def small_groups(occupied: Index, counts: Index, group: int) -> Bool:
    """Which of the boxes (m,), ascending, belong to groups of at most ``group`` points that nothing else touches.

    Args:
        occupied, counts: (m,) the boxes' numbers, see ``box_numbers``, and their points.
    """
    first, second = [], []
    for step in _NEIGHBOUR_STEPS:
        neighbours = occupied + int(np.dot(step, _STRIDES))
        place = np.minimum(np.searchsorted(occupied, neighbours), len(occupied) - 1)
        touching = np.flatnonzero(occupied[place] == neighbours)
        first.append(touching)
        second.append(place[touching])
    rows, columns = np.concatenate(first), np.concatenate(second)
    links = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(len(occupied), len(occupied)))
    number, label = connected_components(links, directed=False)
    points = np.bincount(label, weights=counts, minlength=number)
    # in a cloud of few points, the largest group is the cloud
    small = (points <= group) & (points < points.max())
    return np.asarray(small[label], dtype=np.bool_)
