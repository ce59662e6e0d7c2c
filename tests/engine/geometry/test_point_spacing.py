"""The spacing of points, by that of grids."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry import numbered
from slopewatch.engine.geometry.point_spacing import point_spacing


def grid(spacing: float, count: int = 80) -> np.ndarray:
    x, y = np.meshgrid(np.arange(count) * spacing + 0.001, np.arange(count) * spacing + 0.001)
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.mark.parametrize("spacing", [0.05, 0.25, 1.0, 6.0])
def test_spacing_is_that_of_a_grid(spacing):
    assert point_spacing(grid(spacing)) == pytest.approx(spacing, rel=0.1)


def test_gaps_and_the_place_do_not_matter():
    xy = grid(0.25)
    left = xy[(xy[:, 0] < 5) | (xy[:, 0] > 12)]
    assert point_spacing(left) == pytest.approx(0.25, rel=0.1)
    assert point_spacing(left + [500_000, 3_500_000]) == pytest.approx(point_spacing(left), rel=0.02)


def test_points_at_one_place_have_a_spacing_too():
    assert 0 < point_spacing(np.zeros((100, 2))) <= 1.0


def test_sorting_the_squares_of_a_wide_cloud_counts_as_an_array_of_all_does(monkeypatch):
    xy = np.random.default_rng(0).uniform(0, [30.0, 9.0], (4000, 2))
    counted = point_spacing(xy)
    monkeypatch.setattr(numbered, "MAX_EXTENT_POINTS", 0)
    monkeypatch.setattr(numbered, "MAX_SMALL_EXTENT", 0)
    assert point_spacing(xy) == counted
