"""Slope of the cells against planes of known gradient and numpy's least squares."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.grid import cell_slope
from slopewatch.engine.grid.cell_slope import gradient_at, slope_degrees
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.statistics import window_sums

GRID = Grid(500_000.0, 3_500_000.0, 0.25, 30, 40)


def heights(east: float, north: float, up: float = 0.0) -> np.ndarray:
    row, column = np.indices(GRID.shape)
    return 700.0 + up + GRID.cell * (east * column - north * row)


def gradient(surfaces: list[np.ndarray], **options) -> list[np.ndarray]:
    """Of every cell, (rows, columns), of heights (rows, columns) with NaN where unknown."""
    known = [(np.flatnonzero(np.isfinite(z)), z[np.isfinite(z)]) for z in surfaces]
    found = gradient_at(np.arange(GRID.rows * GRID.columns), known, GRID, **options)
    return [component.reshape(GRID.shape) for component in found]


def test_a_plane_has_its_gradient_everywhere():
    found = gradient([heights(0.3, -1.7)])
    assert np.allclose(found[0], 0.3)
    assert np.allclose(found[1], -1.7)
    assert slope_degrees(found)[3, 3] == pytest.approx(np.degrees(np.arctan(np.hypot(0.3, 1.7))))


def test_two_epochs_share_the_slope_but_not_the_height():
    """Half of the later epoch is unknown: pooled heights would see a cliff where it begins."""
    second = heights(0.3, -1.7, up=5.0)
    second[:, 20:] = np.nan
    found = gradient([heights(0.3, -1.7), second])
    assert np.allclose(found[0], 0.3)
    assert np.allclose(found[1], -1.7)


def test_a_rough_surface_with_holes_against_least_squares():
    rng = np.random.default_rng(3)
    rough = heights(0.5, 0.8) + rng.normal(0, 0.1, GRID.shape)
    rough[rng.random(GRID.shape) < 0.6] = np.nan
    east, north = gradient([rough], reach=0.5, wider=())
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
    assert np.isnan(gradient([line], wider=())[0]).all()


@pytest.mark.parametrize("few", [0.0, np.inf])
def test_cells_wanted_have_the_slope_they_have_among_all_of_a_grid_held_in_bands(monkeypatch, few):
    rng = np.random.default_rng(5)
    rough = heights(0.5, 0.8) + rng.normal(0, 0.1, GRID.shape)
    rough[rng.random(GRID.shape) < 0.8] = np.nan
    rough[:9] = np.nan
    wanted = rng.random(GRID.shape) < 0.3
    whole = gradient([rough])
    monkeypatch.setattr(window_sums, "_BAND", 1)
    monkeypatch.setattr(cell_slope, "_MAX_FEW_SHARE", few)
    known = np.isfinite(rough)
    found = gradient_at(np.flatnonzero(wanted), [(np.flatnonzero(known), rough[known])], GRID)
    for component, expected in zip(found, whole, strict=True):
        assert component == pytest.approx(expected[wanted], nan_ok=True, abs=1e-9)


def test_a_wider_reach_where_too_few_cells_are_near():
    sparse = np.full(GRID.shape, np.nan)
    sparse[::7, ::7] = heights(0.3, -1.7)[::7, ::7]
    assert np.isnan(gradient([sparse], wider=())[0]).all()
    east, north = gradient([sparse])
    assert np.isfinite(east).sum() > 0.9 * east.size
    assert east[np.isfinite(east)] == pytest.approx(0.3)
    assert north[np.isfinite(north)] == pytest.approx(-1.7)


def test_one_height_far_off_does_not_spoil_the_others():
    """An error of kilometres must not cost the heights' differences their digits."""
    spoilt = heights(0.3, -1.7)
    spoilt[0, 0] = 9000.0
    east, north = gradient([spoilt], wider=())
    assert east[6:, 6:] == pytest.approx(0.3, abs=1e-9)
    assert north[6:, 6:] == pytest.approx(-1.7, abs=1e-9)
