"""Slope of the cells against planes of known gradient and numpy's least squares."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.cell_slope import slope_degrees, slope_gradient
from slopewatch.engine.gridding import Grid

GRID = Grid(500_000.0, 3_500_000.0, 0.25, 30, 40)


def heights(east: float, north: float, up: float = 0.0) -> np.ndarray:
    row, column = np.indices(GRID.shape)
    return 700.0 + up + GRID.cell * (east * column - north * row)


def test_a_plane_has_its_gradient_everywhere():
    gradient = slope_gradient([heights(0.3, -1.7)], GRID)
    assert np.allclose(gradient[0], 0.3)
    assert np.allclose(gradient[1], -1.7)
    assert slope_degrees(gradient)[3, 3] == pytest.approx(np.degrees(np.arctan(np.hypot(0.3, 1.7))))


def test_two_epochs_share_the_slope_but_not_the_height():
    """Half of the later epoch is unknown: pooled heights would see a cliff where it begins."""
    second = heights(0.3, -1.7, up=5.0)
    second[:, 20:] = np.nan
    gradient = slope_gradient([heights(0.3, -1.7), second], GRID)
    assert np.allclose(gradient[0], 0.3)
    assert np.allclose(gradient[1], -1.7)


def test_a_rough_surface_with_holes_against_least_squares():
    rng = np.random.default_rng(3)
    rough = heights(0.5, 0.8) + rng.normal(0, 0.1, GRID.shape)
    rough[rng.random(GRID.shape) < 0.6] = np.nan
    east, north = slope_gradient([rough], GRID, reach=0.5)
    row, column = np.indices(GRID.shape)
    for i, j in ((0, 0), (12, 17), (29, 39), (5, 38)):
        near = (abs(row - i) <= 2) & (abs(column - j) <= 2) & np.isfinite(rough)
        if near.sum() < 3:
            continue
        design = np.column_stack([np.ones(near.sum()), GRID.cell * column[near], -GRID.cell * row[near]])
        expected = np.linalg.lstsq(design, rough[near], rcond=None)[0]
        assert (east[i, j], north[i, j]) == pytest.approx((expected[1], expected[2]))


def test_cells_in_one_line_tell_no_slope():
    line = np.full(GRID.shape, np.nan)
    line[10] = 700.0
    assert np.isnan(slope_gradient([line], GRID)[0]).all()
