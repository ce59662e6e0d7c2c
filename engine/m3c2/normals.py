"""Normals and roughness of a surface at given places: a plane through the points of a ball around each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..core.compiled import pays
from ..core.progress import Progress
from .kernels import BALL_SUMS, MIN_COMPILED_PLACES, PLACES_PER_CALL, Searched
from .lattice import Lattice, runs

MIN_PLANE_POINTS = 4  # three always lie in a plane
# points whose spread across their line has less than this share of the variance along it fix no plane
_MIN_SPREAD_RATIO = 1e-2
_CHUNK_PROBLEMS = 20_000  # eigenvalue problems a native call, so that cancelling takes effect in time


@dataclass(frozen=True)
class Fits:
    """Planes fitted at m places. ``normal`` (m, 3) of length 1, or zeros where the points fix no plane; ``roughness``
    (m,): standard deviation of the points about the plane, metres, NaN there; ``count`` (m,): points in the ball.
    """

    normal: Float
    roughness: Float
    count: Index

    @property
    def found(self) -> NDArray[np.bool_]:
        return np.isfinite(self.roughness)


def fit_planes(
    lattice: Lattice,
    places: Float,
    diameter: float,
    *,
    orientation: Float | None = None,
    progress: Progress | None = None,
) -> Fits:
    """Fit a plane to the points within ``diameter`` / 2 of each of the ``places`` (m, 3) by principal components.

    Args:
        orientation: (3,) every normal points to its side; upwards by default.
    """
    progress = progress or Progress()
    radius = diameter / 2
    toward = np.array([0.0, 0.0, 1.0]) if orientation is None else np.asarray(orientation, dtype=np.float64)
    count = np.zeros(len(places), dtype=np.int64)
    normal, roughness = np.zeros((len(places), 3)), np.full(len(places), np.nan)
    searched = lattice.searched() if pays(len(places), MIN_COMPILED_PLACES) else None
    loop = None if searched is None else BALL_SUMS.ready()
    if loop is not None:
        found = _compiled_scatter(loop, searched, lattice, places, radius, progress)
    else:
        found = _plain_scatter(lattice, places, radius, progress)
    for which, members, scatter in found:
        count[which] = members
        for start in range(0, len(which), _CHUNK_PROBLEMS):
            part = slice(start, start + _CHUNK_PROBLEMS)
            normal[which[part]], roughness[which[part]] = _planes(members[part], scatter[part])
    normal[normal @ toward < 0] *= -1.0
    return Fits(normal=normal, roughness=roughness, count=count)


def _compiled_scatter(
    loop: Callable[..., None],
    searched: Searched | None,
    lattice: Lattice,
    places: Float,
    radius: float,
    progress: Progress,
) -> Iterator[tuple[Index, Index, Float]]:
    lengths = radius, lattice.reach(np.zeros((0, 3)), radius)
    places, order = np.require(places, np.float64, ["C", "W"]), lattice.along_rows(places)
    count, scatter = np.zeros(len(places), dtype=np.int64), np.zeros((len(places), 3, 3))
    for start in range(0, len(order), PLACES_PER_CALL):
        which = order[start : start + PLACES_PER_CALL]
        loop(searched, which, places, lengths, (count, scatter))
        held = which[count[which] > 0]
        yield held, count[held], scatter[held]
        progress.update((start + len(which)) / len(places))


def _plain_scatter(
    lattice: Lattice, places: Float, radius: float, progress: Progress
) -> Iterator[tuple[Index, Index, Float]]:
    at = np.ascontiguousarray(places.T)
    done = 0
    for number, point in lattice.candidates(places, np.zeros_like(places), radius):
        done += int(np.count_nonzero(number[1:] != number[:-1])) + 1
        local = lattice.offsets(at, number, point)
        inside = np.flatnonzero(local[0] ** 2 + local[1] ** 2 + local[2] ** 2 <= radius**2)
        if len(inside):
            yield _scatter(number.take(inside), [axis.take(inside) for axis in local])
        progress.update(done / max(len(places), 1))


def _scatter(number: Index, local: list[Float]) -> tuple[Index, Index, Float]:
    """Places, their points, and the points' scatter matrices (k, 3, 3) about their own means."""
    which, starts, members = runs(number)
    local = [axis - np.repeat(np.add.reduceat(axis, starts) / members, members) for axis in local]
    matrix = np.empty((len(which), 3, 3))
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        matrix[:, i, j] = matrix[:, j, i] = np.add.reduceat(local[i] * local[j], starts)
    return which, members, matrix


def _planes(members: Index, scatter: Float) -> tuple[Float, Float]:
    values, vectors = np.linalg.eigh(scatter)
    values = np.maximum(values, 0.0)
    plane = (members >= MIN_PLANE_POINTS) & (values[:, 1] > _MIN_SPREAD_RATIO * values[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        # a plane has three parameters
        roughness = np.where(plane, np.sqrt(values[:, 0] / (members - 3)), np.nan)
    return np.where(plane[:, None], vectors[:, :, 0], 0.0), roughness
