"""Probabilities of points as scores of cells: means by hand, odds against arithmetic, levels in order."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.models.preparation.point_scores import CENTRED, LEVELS, OUTLINE, cell_means, level_for, point_scores
from slopewatch.models.preparation.relief_raster import relief_raster


def test_a_cell_has_the_mean_over_the_points_that_its_averages_stand_for() -> None:
    index = np.array([0, 0, 2]), np.array([1, 1, 0])
    values = np.array([[0.2, 1.0], [0.8, 2.0], [0.5, 3.0]])
    mean = cell_means(values, index, np.array([3, 1, 7]), np.array([[False, True], [False, False], [True, True]]))
    np.testing.assert_allclose(mean[:, 0, 1], [0.35, 1.25])
    np.testing.assert_allclose(mean[:, 2, 0], [0.5, 3.0])
    # An empty cell takes the nearest one's; where no ground is, nothing.
    np.testing.assert_allclose(mean[:, 2, 1], [0.5, 3.0])
    assert np.isnan(mean[:, [0, 1, 1], [0, 0, 1]]).all()


def test_cell_means_fill_small_gaps_only() -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(0, 20, (1500, 2)), rng.normal(0, 0.02, 1500)])
    flat = flat[np.hypot(flat[:, 0] - 10, flat[:, 1] - 10) > 4]
    raster = relief_raster(flat)
    (mean,) = cell_means(flat[:, :1], raster.index(flat), np.ones(len(flat)), raster.covered)
    assert np.isnan(mean[20, 20])
    middle = raster.origin[0] + (np.arange(raster.shape[0]) + 0.5) * raster.cell
    assert np.nanmax(np.abs(mean - middle[:, None])) < 1.3
    np.testing.assert_array_equal(np.isfinite(mean), raster.covered)


def test_scores_are_the_odds_against_all_else_relative_to_the_slope() -> None:
    given = np.random.default_rng(0).dirichlet([8.0, 1.0, 1.0], (20, 30)).transpose(2, 0, 1)
    given[:, :3] = np.nan
    up, down = np.log(given[1] / (given[0] + given[2])), np.log(given[2] / (given[0] + given[1]))
    scores = point_scores(given, 0.5)
    middle = np.nanmedian(np.stack([up, down]))
    np.testing.assert_allclose(scores.uplift, up - CENTRED * middle, rtol=1e-6)
    np.testing.assert_allclose(scores.subsidence, down - CENTRED * middle, rtol=1e-6)
    assert scores.outline == OUTLINE
    sure = np.zeros((3, 4, 4))
    sure[0] = 1.0
    assert np.isfinite(point_scores(sure, 0.5).uplift).all()


def test_fewer_false_zones_need_a_higher_level() -> None:
    levels = [level_for(rate) for rate in (0.1, 0.15, 0.5, 1.0, 1.5, 10.0)]
    assert levels == sorted(levels, reverse=True)
    assert len(set(levels)) == len(levels)
    assert level_for(1.0) == LEVELS[1.0]
    assert level_for(2.0) == pytest.approx(LEVELS[2.0])
