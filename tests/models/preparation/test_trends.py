"""Robust trends against weighted least squares done cell by cell, and against slopes whose bulges are known."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.models.preparation.trends import TURNS, local_planes, residual_heights, robust_trend


def test_the_local_plane_is_weighted_least_squares():
    rng = np.random.default_rng(1)
    z, weight = rng.standard_normal((30, 40)), rng.uniform(0.1, 1.0, (30, 40))
    weight[rng.random((30, 40)) < 0.2] = 0.0
    fast = local_planes(z * (weight > 0), weight, (3.0, 2.0))
    i, j = np.meshgrid(np.arange(30), np.arange(40), indexing="ij")
    for row, column in [(15, 20), (0, 0), (29, 7), (12, 39)]:
        a, b = (i - row) / 3.0, (j - column) / 2.0
        kernel = np.exp(-0.5 * (a**2 + b**2)) * (np.abs(a) <= 3) * (np.abs(b) <= 3)
        w = np.sqrt(kernel * weight).ravel()
        design = np.stack([np.ones(a.size), a.ravel(), b.ravel()], axis=1)
        solution = np.linalg.lstsq(design * w[:, None], z.ravel() * w, rcond=None)[0]
        assert fast[row, column] == pytest.approx(solution[0], abs=5e-3)


def test_a_plane_is_its_own_trend_where_cells_are_missing():
    i, j = np.meshgrid(np.arange(40.0), np.arange(50.0), indexing="ij")
    height = 0.3 * i - 0.2 * j + 5
    holes = height.copy()
    holes[np.random.default_rng(2).random(height.shape) < 0.4] = np.nan
    np.testing.assert_allclose(robust_trend(holes, (4.0, 4.0)), height, atol=0.02)


def slope(bulge, steps=0.0):
    """20 points a m² on 40 x 30 m: a bulge of radius 1.5 m at (20, 15), and a step of ``steps`` m every 8 m of y."""
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 1, (24_000, 2)) * (40, 30)
    r2 = ((xy[:, 0] - 20) ** 2 + (xy[:, 1] - 15) ** 2) / 1.5**2
    rise = bulge * np.maximum(1 - r2, 0)
    z = 0.05 * xy[:, 0] + steps * np.floor(xy[:, 1] / 8) + rise + rng.normal(0, 0.01, len(xy))
    return np.column_stack([xy, z]), rise


@pytest.mark.parametrize("bulge", [0.3, -0.3])
def test_a_bulge_stands_over_its_robust_trend(bulge):
    xyz, rise = slope(bulge)
    residual = residual_heights(xyz, 4.0, 4.0)
    assert np.abs(residual - rise).mean() < 0.02
    top = np.abs(rise) > 0.8 * abs(bulge)
    assert residual[top].mean() == pytest.approx(rise[top].mean(), abs=0.05)
    # Without the robust turns the bulge lifts its own trend by more.
    assert TURNS > 1


def test_a_trend_along_the_slope_follows_benches():
    xyz, rise = slope(0.3, steps=1.0)
    inside = (xyz[:, 0] > 3) & (xyz[:, 0] < 37)
    # Away from the steps' own edges.
    inside &= np.abs((xyz[:, 1] + 4) % 8 - 4) > 0.8
    along, round_ = residual_heights(xyz, 10.0, 0.6), residual_heights(xyz, 4.0, 4.0)
    assert np.abs(along - rise)[inside].mean() < 0.03
    assert np.abs(round_ - rise)[inside].mean() > 0.1
