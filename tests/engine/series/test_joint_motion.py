"""The motion of a zone from the points of several surveys whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.grid.block_moments import cell_moments
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.series.joint_motion import joint_motion
from slopewatch.engine.series.zone_grounds import outlined

SIDE, SIGMA = 0.4, 0.02
GRID = Grid(0.0, 8.0, SIDE, 20, 20)
TIMES = (0.0, 0.3, 0.6, 1.0)
MIDDLE = np.array([4.1, 3.9])


def bowl(xy: np.ndarray) -> np.ndarray:
    """0.3 m deep, with half-axes of 2 and 1.6 m."""
    u, v = ((xy - MIDDLE) / (2.0, 1.6)).T
    return -0.3 * np.maximum(1.0 - u**2 - v**2, 0.0) ** 2


def cone(xy: np.ndarray) -> np.ndarray:
    """0.4 m high, 4 m wide."""
    return 0.4 * np.maximum(1.0 - np.hypot(*(xy - MIDDLE).T) / 2.0, 0.0)


def block(xy: np.ndarray) -> np.ndarray:
    """3 by 3 m, with vertical edges 0.3 m high, across the cells."""
    turned = (xy - MIDDLE) @ np.array([[0.94, -0.342], [0.342, 0.94]])
    return np.where(np.abs(turned).max(axis=1) < 1.5, 0.3, 0.0)


SHAPES = {bowl: np.pi * 3.2 * (1 - 0.1**0.5), cone: np.pi * 4 * 0.9**2, block: 9.0}
"""With the area that moved by a tenth of the most or more, m²."""


def surveys(shape, seed: int, density: float = 30.0, times=TIMES) -> list[np.ndarray]:
    """Sums of points on a steep rough slope that moves by ``shape`` times each of the ``times``."""
    rng = np.random.default_rng(seed)
    sums = []
    for time in times:
        xy = rng.uniform(0, 8, (rng.poisson(density * 64), 2))
        rough = 0.03 * np.sin(4 * xy[:, 0] + 1) * np.cos(3 * xy[:, 1])
        z = 0.8 * xy[:, 1] + rough + time * shape(xy) + rng.normal(0, SIGMA, len(xy))
        sums.append(cell_moments(np.column_stack([xy, z]), GRID, 3.0).sums)
    return sums


def cells_of(shape, share: float) -> np.ndarray:
    """Cells whose middle moves by ``share`` of the most or more."""
    row, column = np.indices(GRID.shape)
    change = np.abs(shape(np.column_stack([(column.ravel() + 0.5) * SIDE, 8.0 - (row.ravel() + 0.5) * SIDE])))
    return (change >= share * change.max()).reshape(GRID.shape)


def mean_of(shape, inside: np.ndarray) -> float:
    """Of the cells ``inside``."""
    row, column = np.nonzero(inside)
    v, u = ((np.indices((8, 8)) + 0.5) / 8).reshape(2, 1, -1)
    places = np.stack([((column[:, None] + u) * SIDE).ravel(), (8.0 - (row[:, None] + v) * SIDE).ravel()], axis=1)
    return float(shape(places).mean())


@pytest.mark.parametrize("shape", SHAPES)
def test_the_area_is_that_of_what_moved_by_a_tenth_of_the_most(shape):
    ratios = []
    for seed in range(2):
        found = joint_motion(surveys(shape, seed), TIMES, cells_of(shape, 0.4), SIDE)
        sign = 1 if shape is not bowl else -1
        inside = outlined(sign * found.motion, found.multiple, cells_of(shape, 0.4), np.ones(GRID.shape, dtype=bool))
        ratios.append(inside.sum() * SIDE**2 / SHAPES[shape])
    limit = 0.25 if shape is block else 0.1  # an edge within a cell is not sharp
    assert np.median(ratios) == pytest.approx(1.0, abs=limit)


def test_means_of_surveys_do_not_lean_and_err_as_stated():
    deviations, inside = [], cells_of(bowl, 0.1)
    for seed in range(4):
        found = joint_motion(surveys(bowl, 20 + seed), TIMES, cells_of(bowl, 0.4), SIDE)
        mean, variance = found.of_surveys(inside)
        assert (mean[0], variance[0]) == (0.0, 0.0)
        true = mean_of(bowl, inside) * np.array(TIMES)
        deviations += ((mean - true) / np.sqrt(np.maximum(variance, 1e-12)))[1:].tolist()
    assert abs(np.mean(deviations)) < 1.0  # surveys of a seed share the first one's error
    assert 0.5 < np.sqrt(np.mean(np.square(deviations))) < 1.5


def test_a_survey_of_which_only_half_moved_is_measured_as_it_did():
    moved = surveys(bowl, 3)
    moved[2] = surveys(lambda xy: bowl(xy) * (xy[:, 1] < MIDDLE[1]), 43, times=(0.6,))[0]
    inside = cells_of(bowl, 0.1)
    mean, variance = joint_motion(moved, (0.0, 0.3, 0.3, 1.0), cells_of(bowl, 0.4), SIDE).of_surveys(inside)
    half = mean_of(lambda xy: 0.6 * bowl(xy) * (xy[:, 1] < MIDDLE[1]), inside)
    assert mean[2] == pytest.approx(half, abs=3 * variance[2] ** 0.5)
    assert mean[3] == pytest.approx(mean_of(bowl, inside), abs=3 * variance[3] ** 0.5)


def test_the_error_grows_where_few_points_are():
    dense, sparse = (joint_motion(surveys(bowl, 5, d), TIMES, cells_of(bowl, 0.4), SIDE) for d in (40.0, 10.0))
    inside = cells_of(bowl, 0.1)
    assert sparse.of_surveys(inside)[1][3] > 2 * dense.of_surveys(inside)[1][3]


def test_large_windows_are_fitted_in_larger_cells():
    rng = np.random.default_rng(6)
    grid = Grid(0.0, 9.0, 0.2, 45, 43)
    sums = []
    for time in (0.0, 1.0):
        xy = rng.uniform(0, 8.6, (6000, 2))
        z = 0.5 * xy[:, 0] + time * cone(xy) + rng.normal(0, SIGMA, len(xy))
        sums.append(cell_moments(np.column_stack([xy, z]), grid, 2.0).sums)
    row, column = np.indices(grid.shape)
    own = (np.hypot((column + 0.5) * 0.2 - MIDDLE[0], 9.0 - (row + 0.5) * 0.2 - MIDDLE[1]) < 1.2).astype(bool)
    found = joint_motion(sums, (0.0, 1.0), own, 0.2)
    assert (found.multiple, found.motion.shape) == (2, (24, 23))
    inside = outlined(found.motion, 2, own, np.ones(grid.shape, dtype=bool))
    assert inside.sum() * 0.04 == pytest.approx(SHAPES[cone], rel=0.1)


def test_intervals_hold_where_the_ground_ends_at_a_high_edge():
    times, deviations = np.array(TIMES), []
    for seed in range(6):
        found = joint_motion(surveys(block, 60 + seed, 100.0, 4 * times), TIMES, cells_of(block, 0.4), SIDE)
        inside = outlined(found.motion, found.multiple, cells_of(block, 0.4), np.ones(GRID.shape, dtype=bool))
        mean, variance = found.of_surveys(inside)
        deviations += ((mean - 4 * times * mean_of(block, inside))[1:] / variance[1:] ** 0.5).tolist()
    assert np.mean(np.abs(deviations) < 1.96) >= 0.8, "beyond a step the fit undershoots"
