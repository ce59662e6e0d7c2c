"""What the last survey knows, and the level and motion expected of the next."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from slopewatch.engine.flight.expected import expected_level, first_cell, smallest_motion
from slopewatch.engine.flight.last_survey import Scatter, clumping_of, even_scatter, scatter_of, scatter_within, seen_by
from slopewatch.engine.flight.terrain import terrain_of_points
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.grid.growing_cells import adaptive_cells
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.tests.builders.flights import inclined


def test_scatter_is_the_noise_about_an_inclined_plane() -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0, 40, (60_000, 2))
    z = 0.8 * xy[:, 0] - 0.3 * xy[:, 1] + rng.normal(0, 0.025, len(xy))
    found = scatter_of(np.column_stack([xy, z]))
    assert found is not None
    assert found.side[-1] == 6.4  # 36 whole squares are enough, the nine of 12.8 m are not
    np.testing.assert_allclose(found.deviation, 0.025, rtol=0.06)
    assert scatter_of(np.column_stack([xy, z])[:40]) is None


def test_scatter_grows_with_the_square_where_ground_is_rough() -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 40, (60_000, 2))
    z = 0.1 * np.sin(2 * np.pi * xy[:, 0] / 3.0) + rng.normal(0, 0.01, len(xy))
    found = scatter_of(np.column_stack([xy, z]))
    assert found is not None
    assert found.at(0.4) < 0.6 * found.at(1.6) < found.at(3.2)
    assert found.at(3.2) == pytest.approx(np.hypot(0.1 / np.sqrt(2), 0.01), rel=0.2)
    assert found.at(100.0) == found.deviation[-1]


def test_the_scatter_is_that_of_the_region_where_it_has_enough() -> None:
    """A rough half and a smooth one: the region's own counts, and all where it has too few returns."""
    rng = np.random.default_rng(7)
    xy = rng.uniform(0, 40, (40_000, 2))
    xyz = np.column_stack([xy, rng.normal(0, np.where(xy[:, 0] < 20, 0.01, 0.08))])
    for west, wanted in ((0.0, 0.01), (20.0, 0.08)):
        found = scatter_within(xyz, shapely.box(west, 0, west + 20, 40))
        assert found is not None
        assert found.at(0.8) == pytest.approx(wanted, rel=0.05)
    assert scatter_within(xyz, shapely.box(500, 0, 520, 40)) == scatter_of(xyz)
    assert scatter_within(xyz[:40], shapely.box(0, 0, 20, 40)) is None


def test_the_share_of_pulses_that_reach_the_ground_is_counted_place_by_place() -> None:
    rng = np.random.default_rng(4)
    grid = Grid(0.0, 40.0, 2.0, 20, 20)
    first = rng.uniform(0, 40, (40_000, 2))
    ground = first[rng.random(len(first)) < np.where(first[:, 0] < 20, 0.8, 0.1)]
    seen = seen_by(grid, first, ground, 60_000)
    assert seen.returns_a_pulse == 1.5
    assert seen.ground_share[:, :10].mean() == pytest.approx(0.8, abs=0.02)
    assert seen.ground_share[:, 10:].mean() == pytest.approx(0.1, abs=0.02)
    row, column = 3, 15
    inside = (np.floor(first[:, 0] / 2) == column) & (np.floor(first[:, 1] / 2) == 19 - row)
    assert seen.pulses[row, column] == inside.sum()


def test_the_level_is_that_of_the_change_on_random_returns() -> None:
    """Two surveys of an inclined plane with known noise, compared by the change itself."""
    rng = np.random.default_rng(6)
    clouds = []
    for _ in range(2):
        xy = rng.uniform(0, 24, (20 * 24 * 24, 2))
        clouds.append(np.column_stack([xy, 0.6 * xy[:, 0] + rng.normal(0, 0.04, len(xy))]))
    cell = first_cell(np.full(3, 20.0))
    grid = Grid(0.0, 24.0, cell, round(24 / cell), round(24 / cell))
    parameters = ChangeParameters(cell=cell)
    grown = adaptive_cells(clouds[0], clouds[1], grid, parameters, registration_error=0.005)
    known = np.isfinite(grown.dz)
    reached = 1.959964 * np.median(np.hypot(grown.sampling[known], 0.005))
    expected = expected_level(np.full(3, 20.0), 0.0, even_scatter(0.04), 0.005, 0.95)
    assert expected == pytest.approx(reached, rel=0.1)


def test_the_level_follows_returns_clumps_and_plants() -> None:
    density = np.array([0.0, 20.0, 3000.0])
    even = expected_level(density, 0.0, even_scatter(0.05), 0.002, 0.95)
    assert np.isnan(even[0])
    assert even[1] > even[2] > 1.96 * 0.002
    plants = expected_level(density, 0.0, even_scatter(0.05), 0.002, 0.95, 0.03)
    np.testing.assert_allclose(plants[1:], np.hypot(even[1:], 1.959964 * 0.03))
    motion = smallest_motion(np.array([0.0, 3.0, 70.0]), 10.0)
    assert np.isnan(motion[0])
    assert motion[1] > motion[2] == pytest.approx(3 * 0.028 / 2)


def test_clumping_is_that_of_the_density_and_no_chance() -> None:
    rng = np.random.default_rng(8)
    grid = Grid(0.0, 40.0, 2.0, 20, 20)
    mean = 16.0 * rng.gamma(2.0, 0.5, (100, 100))
    counts = rng.poisson(mean)
    rows, columns = np.nonzero(counts)
    many = counts[rows, columns]
    corner = np.repeat(np.column_stack([columns * 0.4, 40.0 - (rows + 1) * 0.4]), many, axis=0)
    clumped = clumping_of(grid, corner + rng.uniform(0, 0.4, corner.shape))
    assert np.median(clumped) == pytest.approx(0.5, abs=0.08)
    assert np.median(clumping_of(grid, rng.uniform(0, 40, (160_000, 2)))) < 0.01


def test_scatter_that_is_known_at_one_side_holds_at_all() -> None:
    assert Scatter((0.4,), (0.02,)).at(1.6) == 0.02


def test_terrain_of_points_bridges_gaps_and_a_rim_and_no_more() -> None:
    truth = inclined(60, 60, slope=0.5)
    rng = np.random.default_rng(7)
    west, south, _, _ = truth.grid.bounds
    xy = rng.uniform(2, 58, (20_000, 2)) + (west, south)
    gap = (np.abs(xy[:, 0] - west - 30) < 4) & (np.abs(xy[:, 1] - south - 30) < 4)
    xyz = np.column_stack([xy, truth.at(xy)])[~gap]
    terrain = terrain_of_points(xyz, truth.crs, truth.path, 6.0)
    middle = np.array([[west + 30.0, south + 30.0], [west - 2.0, south + 30.0], [west - 8.0, south + 30.0]])
    heights = terrain.at(middle)
    assert heights[0] == pytest.approx(truth.at(middle[:1])[0], abs=0.3)
    assert np.isfinite(heights[1])
    assert np.isnan(heights[2])
    inside = xy[~gap][:500]
    np.testing.assert_allclose(terrain.at(inside), truth.at(inside), atol=0.6)
