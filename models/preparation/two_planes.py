"""Whether ground is two planes rather than one: each square goes to the plane that it lies closer to, in turns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float

_SQUARE_M = 2.0
_MIN_SQUARE_POINTS = 3
_MIN_SQUARES = 10
_STARTS, _ROUNDS = 8, 20


@dataclass(frozen=True)
class TwoPlanes:
    """``share`` (0 to 0.5) of the ground on the smaller plane, the ``angle`` (degrees) between both, and what they
    leave of the scatter about one plane, ``left`` (0 to 1).
    """

    share: float
    angle: float
    left: float


ONE_PLANE = TwoPlanes(0.0, 0.0, 1.0)


def two_planes(xyz: Float) -> TwoPlanes:
    """The two planes that describe points (n, 3; m) best, by k-planes clustering (Bradley and Mangasarian 2000,
    doi:10.1023/A:1008324625522) from halves in several directions; one plane where there is too little ground.
    """
    places = _square_means(xyz)
    best = ONE_PLANE
    if len(places) < 2 * _MIN_SQUARES:
        return best
    middle, normal = _plane(places)
    scatter = float(np.sqrt(np.mean(((places - middle) @ normal) ** 2)))
    centred = places - middle
    axes = np.linalg.svd(centred, full_matrices=False)[2][:2]
    for turn in np.linspace(0.0, math.pi, _STARTS, endpoint=False):
        along = centred @ (axes[0] * math.cos(turn) + axes[1] * math.sin(turn))
        found = _settled(places, along > np.median(along))
        if found is None:
            continue
        first, away, angle = found
        left = float(np.sqrt(np.mean(away**2))) / max(scatter, 1e-9)
        if left < best.left:
            share = float(first.mean())
            best = TwoPlanes(min(share, 1.0 - share), angle, left)
    return best


def _settled(places: Float, first: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Float, float] | None:
    """Which places are on the first plane, the distance (n,) of each to its own, and the angle; None where one of the
    planes has too few.
    """
    for _ in range(_ROUNDS):
        if min(np.count_nonzero(first), np.count_nonzero(~first)) < _MIN_SQUARES:
            return None
        planes = [_plane(places[which]) for which in (first, ~first)]
        away = np.abs(np.stack([(places - middle) @ normal for middle, normal in planes]))
        nearer = away[0] < away[1]
        if (nearer == first).all():
            break
        first = nearer
    cosine = abs(float(planes[0][1] @ planes[1][1]))
    return first, away.min(axis=0), math.degrees(math.acos(min(cosine, 1.0)))


def _plane(places: Float) -> tuple[Float, Float]:
    """Middle (3,) and normal (3,) of the plane of least squares."""
    middle = places.mean(axis=0)
    return middle, np.linalg.svd(places - middle, full_matrices=False)[2][2]


def _square_means(xyz: Float) -> Float:
    """Means (m, 3) of the points in squares of the map."""
    cell = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / _SQUARE_M).astype(np.int64)
    _, square, count = np.unique(
        cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1], return_inverse=True, return_counts=True
    )
    local = xyz - xyz.mean(axis=0)
    mean = np.column_stack([np.bincount(square, weights=local[:, axis]) / count for axis in range(3)])
    return np.asarray(mean[count >= _MIN_SQUARE_POINTS])
