"""Robust fits of bumps: against least squares window by window, known shapes, and noise."""

import numpy as np
import pytest
from slopewatch.models.preparation.bump_filter import (
    BACKGROUND_DIAMETERS,
    ROUNDS,
    SCALE_ROUNDS,
    TUKEY,
    bump,
    cell_heights,
    fit_bumps,
)

CELL = 0.5


def points(width: float, density: float, seed: int = 0) -> np.ndarray:
    """Random places (n, 2) on a square."""
    return np.random.default_rng(seed).uniform(0, width, (round(density * width**2), 2))


def lattice(xyz: np.ndarray, width: float):
    return cell_heights(xyz, CELL, np.zeros(2), (round(width / CELL), round(width / CELL)))


def fitted_by_points(xyz: np.ndarray, place: np.ndarray, diameter: float) -> float:
    """Height of the bump by iteratively reweighted least squares on the points about a place, with nothing gridded."""
    x, y = (xyz[:, :2] - place).T
    near = np.hypot(x, y) <= BACKGROUND_DIAMETERS * diameter / 2
    x, y, z = x[near], y[near], xyz[near, 2]
    columns = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y, bump(np.hypot(x, y), diameter)])
    weight = np.ones(len(z))
    for turn in range(ROUNDS):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(columns * root[:, None], z * root, rcond=None)[0]
        residual = z - columns @ solution
        if turn < SCALE_ROUNDS:
            scale = 1.4826 * np.median(np.abs(residual))
        weight = (1 - np.minimum(np.abs(residual) / (TUKEY * scale), 1) ** 2) ** 2
    return float(solution[-1])


def test_the_fit_agrees_with_one_on_the_points_themselves() -> None:
    xy = points(16, 60)
    wave = 0.3 * np.sin(xy[:, 0]) * np.cos(0.8 * xy[:, 1])
    z = wave + 0.2 * xy[:, 0] + np.random.default_rng(1).normal(0, 0.02, len(xy))
    xyz = np.column_stack([xy, z])
    cells = lattice(xyz, 16)
    fit = fit_bumps(cells, 3.0, cells.covered)
    places = [(i, j) for i in range(10, 22, 2) for j in range(10, 22, 2)]
    truth = np.array([fitted_by_points(xyz, (np.array(p) + 0.5) * CELL, 3.0) for p in places])
    ours = np.array([fit.amplitude[p] for p in places])
    assert np.std(truth) > 0.1
    # Cells of 0.5 m and points are two looks at one surface.
    assert np.sqrt(np.mean((ours - truth) ** 2)) < 0.012
    assert np.corrcoef(ours, truth)[0, 1] > 0.995


def test_a_bump_on_a_curved_slope_is_as_high_as_it_was_made() -> None:
    xy = points(20, 40)
    x, y = (xy - 10.25).T
    z = 0.4 * bump(np.hypot(x, y), 3.0) + 0.3 * x + 0.02 * x * x - 0.015 * x * y + 30.0
    cells = lattice(np.column_stack([xy, z]), 20)
    fit = fit_bumps(cells, 3.0, cells.covered)
    assert np.unravel_index(np.nanargmax(fit.amplitude), fit.amplitude.shape) == (20, 20)
    assert fit.amplitude[20, 20] == pytest.approx(0.4, abs=0.01)
    down = fit_bumps(lattice(np.column_stack([xy, -z]), 20), 3.0, cells.covered)
    np.testing.assert_allclose(down.amplitude[15:25, 15:25], -fit.amplitude[15:25, 15:25], atol=2e-3)


def test_the_standard_error_is_the_scatter_of_heights_on_even_ground() -> None:
    heights, errors = [], []
    for seed in range(4):
        xy = points(30, 12, seed)
        z = np.random.default_rng(100 + seed).normal(0, 0.05, len(xy))
        cells = lattice(np.column_stack([xy, z]), 30)
        fit = fit_bumps(cells, 2.0, np.ones((60, 60), dtype=bool))
        heights.append(fit.amplitude[8:-8, 8:-8].ravel())
        errors.append(fit.error[8:-8, 8:-8].ravel())
    assert np.std(np.concatenate(heights)) == pytest.approx(np.mean(np.concatenate(errors)), rel=0.12)


def test_a_boulder_beside_the_place_hardly_counts() -> None:
    xy = points(16, 40)
    z = np.random.default_rng(2).normal(0, 0.02, len(xy))
    boulder = np.hypot(*(xy - [10.25, 8.25]).T) < 0.5
    cells = lattice(np.column_stack([xy, z + 0.8 * boulder]), 16)
    fit = fit_bumps(cells, 3.0, cells.covered)
    # Plain least squares gives -0.06 m here.
    assert abs(fit.amplitude[16, 16]) < 0.02


def test_no_value_where_points_are_few_or_lie_on_one_side() -> None:
    xy = points(20, 30)
    xy = xy[xy[:, 0] < 12]
    cells = cell_heights(np.column_stack([xy, np.zeros(len(xy))]), CELL, np.zeros(2), (40, 40))
    fit = fit_bumps(cells, 3.0, np.ones((40, 40), dtype=bool))
    assert np.isfinite(fit.t[6:18, 6:34]).all()
    assert np.isnan(fit.t[26:]).all()
    single = cell_heights(np.zeros((1, 3)) + 5.0, CELL, np.zeros(2), (40, 40))
    assert np.isnan(fit_bumps(single, 3.0, np.ones((40, 40), dtype=bool)).t).all()


def test_cells_hold_the_height_at_their_middle() -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 10, (600, 2))
    cells = lattice(np.column_stack([xy, 100 + 0.6 * xy[:, 0] - 0.3 * xy[:, 1]]), 10)
    i, j = np.nonzero(cells.count >= 2)
    expected = 100 + 0.6 * (i + 0.5) * CELL - 0.3 * (j + 0.5) * CELL
    # Means at the cells' points would be off by 0.06 m.
    assert np.sqrt(np.mean((cells.height[i, j] - expected) ** 2)) < 0.015
    assert cells.count.sum() == 600
    with pytest.raises(ValueError, match="Points reach"):
        cell_heights(np.column_stack([xy, xy[:, 0]]), CELL, np.zeros(2), (5, 5))
