"""Whether points that somebody classified as ground are one surface."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float, Index
from ..core.errors import InputError
from ..core.messages import shown
from ..geometry.dominant_plane import apply_matrix, flattening_matrix
from ..geometry.point_spacing import point_spacing
from ..pointcloud.in_parts import Points, bounds_of, every_of, parts_of
from .cover import percent
from .filtering import dominant_plane
from .tally import square_keys, square_places

Warn = Callable[[str], None]
"""Takes a sentence."""
CLOSE_DISTANCE_M, MIN_CLOSE_POINTS, MAX_STEP_M = 0.5, 3, 0.3
"""A point that has so many others so close contradicts them if half of them lie farther above or below it than the
step, apart from the inclination around it."""
FITTED_NEIGHBOURS = 12
"""Nearest points to which the ground around is fitted."""
_MIN_WARNED_SHARE, _MIN_REFUSED_SHARE = 0.02, 0.6
"""Shares of points from which a warning is given, and from which they are no surface. Real classes have 0 to 0.5 %,
those of a gorge under forest 50 %; whole surveys with their plants 30 to 84 %."""
_MIN_LOWER_SHARE, _MIN_REFUSED_LOWER_SHARE, _MIN_LOWER_POINTS = 0.01, 0.2, 2
"""Shares of the squares of class 2 with so many points below, from which a warning is given, and they are refused. Real
classes have 0 to 0.14 %, the highest point of each square metre of forests 25 to 81 %."""
MAX_SAMPLED_POINTS, MIN_SAMPLED_POINTS, MAX_POINTS, SQUARE_SIDE_M = 20_000, 100, 2_000_000, 10.0
"""Points that are looked at, and least that must have a close neighbour; a larger cloud is looked at in squares."""


def warn_of_classes(path: Path, xyz: Points, warn: Warn) -> None:
    """Warn if points (n, 3), m, of class 2 contradict each other.

    Raises:
        InputError: so many do that they are no surface.
    """
    share = contradicting_share(xyz)
    if share < _MIN_WARNED_SHARE:
        return
    found = (
        f"{percent(share)} of the points of class 2 of {shown(path)} lie more than {MAX_STEP_M:g} m over or below "
        f"those within {CLOSE_DISTANCE_M:g} m around"
    )
    if share >= _MIN_REFUSED_SHARE:
        raise InputError(f"{found}, so they are no surface; extract its ground instead.")
    warn(f"{found}: plants or strays among them; look at them in profile, or extract the ground.")


def warn_of_lower_points(path: Path, ground: Float, others: Float, warn: Warn) -> None:
    """Warn if points (n, 3) of class 2 have many of the others (m, 3), m, below them.

    Raises:
        InputError: so many do that they are no ground.
    """
    share = lower_share(ground, others)
    if share < _MIN_LOWER_SHARE:
        return
    found = (
        f"On {percent(share)} of the area of {shown(path)} with points of class 2, other points lie more than "
        f"{MAX_STEP_M:g} m below them"
    )
    if share >= _MIN_REFUSED_LOWER_SHARE:
        raise InputError(f"{found}, so class 2 is not the ground; extract its ground instead.")
    warn(f"{found}: class 2 may be vegetation or roofs there; look at it in profile, or extract the ground.")


def lower_share(ground: Float, others: Float) -> float:
    """Share of squares of ground (n, 3), m, in which others (m, 3) lie far below the lowest ground around, 0 to 1."""
    if not len(ground) or not len(others):
        return 0.0
    matrix = flattening_matrix(dominant_plane(ground))
    flat, lower = apply_matrix(matrix, ground), apply_matrix(matrix, others)
    side = max(CLOSE_DISTANCE_M, 2.0 * point_spacing(flat[:, :2]))
    key = square_keys(np.floor(flat[:, :2] / side).astype(np.int64))
    keys, square = np.unique(key, return_inverse=True)
    lowest = np.full(len(keys), np.inf)
    np.minimum.at(lowest, square.ravel(), flat[:, 2])
    around = lowest.copy()
    places = square_places(keys)
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        place, known = _places_of(square_keys(places + step), keys)
        around = np.minimum(around, np.where(known, lowest[place], np.inf))
    place, known = _places_of(square_keys(np.floor(lower[:, :2] / side).astype(np.int64)), keys)
    below = known & (lower[:, 2] < around[place] - MAX_STEP_M)
    return float(np.mean(np.bincount(place[below], minlength=len(keys)) >= _MIN_LOWER_POINTS))


def _places_of(wanted: Index, keys: Index) -> tuple[Index, Bool]:
    """(n,) where the wanted numbers (n,) stand among the ascending ``keys`` (m,), and whether they do."""
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return place, np.asarray(keys[place] == wanted, dtype=np.bool_)


def contradicting_share(xyz: Points, *, seed: int = 0) -> float:
    """Share of points (n, 3), m, far above or below those close to them, 0 to 1.

    Points without close ones are not judged and not counted; 0 where nearly all are such.
    """
    if len(xyz) < max(MIN_SAMPLED_POINTS, FITTED_NEIGHBOURS):
        return 0.0
    rng = np.random.default_rng(seed)
    xyz = _in_some_squares(xyz, rng)
    flat = apply_matrix(flattening_matrix(dominant_plane(xyz)), xyz)
    sample = flat[rng.permutation(len(flat))[:MAX_SAMPLED_POINTS]]
    distance, index = cKDTree(flat[:, :2]).query(sample[:, :2], k=FITTED_NEIGHBOURS)
    offset = flat[index] - sample[:, None]
    close = distance[:, 1:] < CLOSE_DISTANCE_M
    rise = np.where(close, (offset[..., 2] - _inclined(offset))[:, 1:], np.nan)
    counted = close.sum(axis=1) >= MIN_CLOSE_POINTS
    if np.count_nonzero(counted) < MIN_SAMPLED_POINTS:
        return 0.0
    return float(np.mean(np.abs(np.nanmedian(rise[counted], axis=1)) > MAX_STEP_M))


def _in_some_squares(xyz: Points, rng: np.random.Generator) -> Float:
    """The points (n, 3) of so many squares as hold about ``MAX_POINTS``; all where they are no more."""
    if len(xyz) <= MAX_POINTS:
        return every_of(xyz, 1)
    low, high = bounds_of(xyz)
    rows = int(np.floor((high[1] - low[1]) / SQUARE_SIDE_M)) + 1

    def squares(part: Float) -> Index:
        place = np.floor((part[:, :2] - low[:2]) / SQUARE_SIDE_M).astype(np.int64)
        return np.asarray(place[:, 0] * rows + place[:, 1])

    last = max(int(squares(part).max()) for part in parts_of(xyz))
    chosen = rng.random(last + 1) < MAX_POINTS / len(xyz)
    return np.concatenate([part[chosen[squares(part)]] for part in parts_of(xyz)])


def _inclined(offset: Float) -> Float:
    """(m, k) rise of the plane through each neighbourhood (m, k, 3), from its first point on."""
    local = offset - offset.mean(axis=1, keepdims=True)
    square = np.einsum("mki,mkj->mij", local[..., :2], local[..., :2]) + 1e-6 * np.eye(2)
    slope = np.linalg.solve(square, np.einsum("mki,mk->mi", local[..., :2], local[..., 2])[..., None])
    return np.asarray((offset[..., :2] @ slope)[..., 0], dtype=np.float64)
