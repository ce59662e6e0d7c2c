"""Attributes of surfaces whose derivatives are known."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.elevation_models.terrain import terrain_of


def _quadratic(cell: float, xx: float, yy: float, xy: float, x1: float, y1: float) -> np.ndarray:
    x = (np.arange(9) - 4) * cell
    y = -(np.arange(9)[:, None] - 4) * cell
    return xx * x**2 / 2 + yy * y**2 / 2 + xy * x * y + x1 * x + y1 * y


def test_rise_slope_and_curvature_of_a_quadratic_surface() -> None:
    found = terrain_of(_quadratic(2.0, 0.02, -0.01, 0.005, 0.3, -0.4), 2.0)
    assert (found.east[4, 4], found.north[4, 4]) == pytest.approx((0.3, -0.4))
    assert found.slope[4, 4] == pytest.approx(np.degrees(np.arctan(0.5)))
    # second derivatives along and across the line of steepest rise (0.6, -0.8)
    along = 0.02 * 0.36 + -0.01 * 0.64 + 2 * 0.005 * 0.6 * -0.8
    across = 0.02 * 0.64 + -0.01 * 0.36 - 2 * 0.005 * 0.6 * -0.8
    assert found.curvature[4, 4] == pytest.approx(max(abs(along), abs(across)))


def test_a_plane_has_no_roughness_and_a_step_has() -> None:
    plane = _quadratic(1.0, 0, 0, 0, 0.7, 0.2) + 80.0
    assert terrain_of(plane, 1.0).roughness[1:-1, 1:-1].max() < 1e-9
    stepped = plane + (np.arange(9) >= 4)
    found = terrain_of(stepped, 1.0).roughness[4, 4]
    window = stepped[3:6, 3:6]
    x = np.array([-1.0, 0.0, 1.0])
    design = np.stack([np.ones(9), np.tile(x, 3), -np.repeat(x, 3)], axis=1)
    best = np.linalg.lstsq(design, window.ravel(), rcond=None)[1]
    assert found == pytest.approx(np.sqrt(best[0] / 9), abs=1e-9)


def test_beside_a_gap_nothing_is_known() -> None:
    heights = _quadratic(1.0, 0, 0, 0, 0.7, 0.2)
    heights[4, 4] = np.nan
    found = terrain_of(heights, 1.0)
    for part in (found.east, found.slope, found.curvature, found.roughness):
        assert np.isnan(part[3:6, 3:6]).all()
        assert np.isfinite(part[1:-1, 7]).all()
