"""Sums of points in cells that a series keeps: cells grow from them as from the points."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.change.epoch_cells import epoch_moments
from slopewatch.engine.core.arrays import Float
from slopewatch.engine.grid import tiled_points
from slopewatch.engine.grid.grid import snapped_grid
from slopewatch.engine.grid.growing_cells import adaptive_cells, adaptive_cells_of_moments
from slopewatch.engine.pointcloud.plant_cover import PlantCover
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.tests.builders.equal_results import same

GRID = snapped_grid((5e5, 3.5e6, 5e5 + 20, 3.5e6 + 12), 0.2)
PARAMETERS = ChangeParameters(cell=0.2)


def survey(count: int, seed: int) -> tuple[Float, PlantCover]:
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, 20, count), rng.uniform(0, 12, count)
    z = 1234.0 + 0.7 * v + 0.2 * np.sin(u) + rng.normal(0, 0.02, count)
    return np.column_stack([5e5 + u, 3.5e6 + v, z]), PlantCover(rng.uniform(0, 0.02, count), rng.uniform(0, 0.3, count))


@pytest.mark.parametrize("in_parts", [False, True])
def test_cells_grow_from_kept_sums_as_from_the_points(monkeypatch, in_parts):
    if in_parts:
        monkeypatch.setattr(tiled_points, "_AT_ONCE", 500)
        monkeypatch.setattr(tiled_points, "_TILE", 24)
    (first, one), (second, two) = survey(9000, 1), survey(1200, 2)
    of_points = adaptive_cells(first, second, GRID, PARAMETERS, registration_error=0.003, plants=(one, two))
    kept = epoch_moments(first, GRID, one), epoch_moments(second, GRID, two)
    of_sums = adaptive_cells_of_moments(*kept, GRID, PARAMETERS, registration_error=0.003)
    np.testing.assert_array_equal(of_sums.partition.block, of_points.partition.block)
    assert len(np.unique(of_points.partition.side)) >= 3
    for name in ("dz", "sampling", "height_from", "height_to", "slope", "count_from", "count_to"):
        np.testing.assert_allclose(getattr(of_sums, name), getattr(of_points, name), rtol=1e-6, atol=1e-8)
    same(of_sums.points, of_points.points)
    np.testing.assert_allclose(of_sums.plants.error_to, of_points.plants.error_to, rtol=1e-9)


def test_another_level_changes_no_figure():
    kept = epoch_moments(survey(3000, 3)[0], GRID)
    other = kept.from_level(1200.0)
    assert other.level == 1200.0
    again = other.from_level(kept.level)
    np.testing.assert_allclose(again.sums, kept.sums, rtol=1e-6, atol=1e-6)
    assert np.sum(other.sums[3]) == pytest.approx(np.sum(kept.sums[3] + kept.points * (kept.level - 1200.0)))


def test_a_survey_without_points_in_the_grid_has_no_cells():
    kept = epoch_moments(survey(100, 4)[0] + [500.0, 0.0, 0.0], GRID)
    assert not len(kept.cell)
