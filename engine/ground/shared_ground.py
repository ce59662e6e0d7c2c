"""Ground of one survey that another survey of the slope helps to find: one ground for two surveys.

Alone, a survey loses ground that bends more than its few points show. In heights over the other survey's ground relief
is level, and only what changed remains. There the ground is looked for again, wherever the other survey has ground and
this one has none. A sheet that lies elsewhere than the other ground is believed if it is new (``_is_new``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.special import bdtrc

from ...interface.seen import REACH_M
from ..core.arrays import Bool, Float, Index
from ..geometry.columns import greatest, least, spans
from ..geometry.dominant_plane import apply_matrix, flattening_matrix
from ..geometry.near_places import near_places
from .densification import Triangles, seed_window_of
from .filtering import dominant_plane, vertical
from .layered_ground import layered_ground
from .surface_heights import Whole

MARGIN_M = 4.0
"""Returns so far around a place are looked at, so that its sheet begins on known ground."""
MIN_GROUND_POINTS = 30
MAX_CHANCE = 0.01
"""Probability that so many returns lie in a sheet by chance, if it is not new."""
MIN_TIMES = 2.0
"""A new sheet holds this many times the share of returns that the other survey has there."""
MAX_BELOW_SHARE, MAX_ABOVE_SHARE = 0.1, 0.5
"""Returns below a raised sheet and right above it, as shares of those in it: more belong to an object or crowns."""


@dataclass(frozen=True)
class Survey:
    """Returns ``xyz`` (n, 3), m; which are ``ground`` (n,), and which may be (``taken``, (n,))."""

    xyz: Float
    ground: Bool
    taken: Bool


@dataclass(frozen=True)
class Found:
    """Returns ``index`` (k,) of a survey that are ground too.

    ``height`` (k,) is that over the ground, ``plant_error`` and ``plant_height`` (k,) are as of ``LayeredGround``; all
    vertical metres.
    """

    index: Index
    height: Float
    plant_error: Float
    plant_height: Float


def shared_ground(own: Survey, other: Survey, threshold: float) -> Found:
    """Ground of ``own`` at places farther than ``REACH_M`` from its ground and nearer than that to the other's.

    Args:
        own, other: in one frame.
        threshold: least distance (m) from the surface within which a point of bare ground is ground.
    """
    nothing = Found(np.zeros(0, dtype=np.int64), *np.zeros((3, 0)))
    if min(np.count_nonzero(survey.ground) for survey in (own, other)) < MIN_GROUND_POINTS:
        return nothing
    plane = dominant_plane(other.xyz[other.ground])
    flat, others = (apply_matrix(flattening_matrix(plane), survey.xyz) for survey in (own, other))
    hole = near_places(others[other.ground], flat, REACH_M) & ~near_places(flat[own.ground], flat, REACH_M)
    if not (hole & own.taken).any():
        return nothing
    reach = 2.0 * REACH_M
    part = np.flatnonzero(near_places(flat[hole], flat, MARGIN_M) & near_places(others[other.ground], flat, reach))
    # no other triangles matter, and a whole survey has far too many
    surface = Triangles(others[other.ground & near_places(flat[hole], others, MARGIN_M + reach)])
    level = _over(surface, flat[part])
    # relief is taken off already
    whole = Whole(least(level[:, :2]), seed_window_of(float(spans(level[:, :2]).min())))
    found = layered_ground(level, own.ground[part], own.taken[part], threshold, whole)
    new = found.ground & hole[part] & np.isfinite(found.plant_error)
    moved = np.flatnonzero(new & (np.abs(level[:, 2]) > found.threshold))
    around = others[near_places(flat[hole], others, REACH_M)]
    new[moved] = _is_new(level, moved, _over(surface, around), found.threshold)
    index = np.flatnonzero(new)
    values = (each[index] * vertical(plane.dip) for each in (found.height, found.plant_error, found.plant_height))
    return Found(part[index], *values)


def _over(surface: Triangles, points: Float) -> Float:
    """Points (n, 3) with their heights over a surface."""
    return np.column_stack([points[:, :2], points[:, 2] - surface.height(points[:, :2])])


def _is_new(own: Float, moved: Index, other: Float, threshold: float) -> Bool:
    """(k,) which of the returns ``moved`` belong to a sheet that lies there in the own survey alone.

    Vegetation that both surveys hold fills the height of a sheet in both. An object or vegetation that is new has
    returns below it. Vegetation has more returns right above its lowest ones; ground has not.

    Args:
        own, other: returns (n, 3) and (m, 3) with their heights over the other survey's ground.
    """
    if not len(moved):
        return np.zeros(0, dtype=np.bool_)
    tree = cKDTree(own[moved, :2])
    group, number = _groups(own[moved])
    counts = []
    for points in (own, other):
        distance, nearest = tree.query(points[:, :2], distance_upper_bound=REACH_M)
        there = np.isfinite(distance)
        place, over = nearest[there], points[there, 2] - own[moved[nearest[there]], 2]
        parts = np.abs(over) <= threshold, over < -2.0 * threshold, (over > threshold) & (over < 3.0 * threshold)
        counts.append([np.bincount(group[place[which]], None, number) for which in (*parts, over < np.inf)])
    (sheet, below, above, every), (same, _, _, others) = counts
    chance = bdtrc(sheet - 1, sheet + same, every / np.maximum(every + others, 1))
    new = (chance <= MAX_CHANCE) & (sheet * others >= MIN_TIMES * same * every)
    rises = np.bincount(group, own[moved, 2], number) > 0
    new &= ~rises | ((below <= MAX_BELOW_SHARE * sheet) & (above <= MAX_ABOVE_SHARE * sheet))
    return np.asarray(new[group], dtype=np.bool_)


def _groups(points: Float) -> tuple[Index, int]:
    """(n,) number of the group of each of the points (n, 3), and how many there are.

    Points of one group lie on one side of the other ground, in adjacent squares of ``REACH_M``.
    """
    square = np.floor((points[:, :2] - least(points[:, :2])) / REACH_M).astype(np.int64)
    cells = np.zeros((2, *(greatest(square) + 1)), dtype=bool)
    side = (points[:, 2] > 0).astype(np.int64)
    cells[side, square[:, 0], square[:, 1]] = True
    low, count = ndimage.label(cells[0], np.ones((3, 3)))
    high, further = ndimage.label(cells[1], np.ones((3, 3)))
    labels = np.stack([low, np.where(high > 0, high + count, 0)])
    return np.asarray(labels[side, square[:, 0], square[:, 1]] - 1, dtype=np.int64), count + further
