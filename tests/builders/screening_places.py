"""Places of the benchmark of screening by sites with scores that are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from slopewatch.lab.benchmarks.screening_ground import POINTS, Place
from slopewatch.lab.benchmarks.screening_trials import Lattice, PlaceResult, Trial

CELL = 0.5
SIDE = 200
"""Cells of 0.5 m along 100 m."""


def peaked(peaks: Sequence[float], first: int = 0) -> np.ndarray:
    """(2, SIDE, SIDE) scores of both signs: 0 but for squares of 1 m², numbered from ``first`` on, of changing sign."""
    score = np.zeros((SIDE, SIDE), dtype=np.float32)
    for k, peak in enumerate(peaks):
        score.ravel()[square(first + k)] = peak * (-1) ** k
    return np.stack([score, -score])


def square(number: int) -> np.ndarray:
    """The numbers of the four cells of a square; squares lie 4.5 m apart, 20 in a row."""
    i, j = divmod(number, 20)
    corner = 9 * i * SIDE + 9 * j
    return corner + np.array([0, 1, SIDE, SIDE + 1])


def scored(
    name: str,
    group: str,
    peaks: list[float],
    strengths: list[float],
    needed: float = 0.4,
    kind: str = POINTS,
    changed: Sequence[float] = (),
) -> PlaceResult:
    """10,000 m² on which zones of 1 m² have the given ``peaks``, and one scene with a hazard for each strength and
    ``changed`` peaks away from them.
    """
    flat = np.column_stack([np.random.default_rng(0).uniform(0, 100, (500, 2)), np.zeros(500)])
    scene = np.maximum(peaked(np.abs(strengths)), peaked(changed, first=200))
    trials = [Trial(0.5, 3.0, (0.0, 0.0), 0.4, 0, 1 + k % 2, square(k)) for k in range(len(strengths))]
    lattice = Lattice(np.zeros(2), CELL, np.ones((SIDE, SIDE), dtype=bool))
    where = Place(name, group, kind, flat, np.eye(4))
    return PlaceResult(where, lattice, needed, 1, trials, {"one": np.stack([peaked(peaks), scene])}, name)


def somewhere(group: str, kind: str = POINTS) -> Place:
    """A flat place of 20 m a side."""
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(0, 20, (3000, 2)), rng.normal(0, 0.05, 3000)])
    return Place(group, group, kind, flat, np.eye(4))
