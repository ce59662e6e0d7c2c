"""A proposed region against clouds whose whole part is known."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.grid.grid import cell_index, snapped_grid
from slopewatch.engine.vector.suggested_region import suggested_region, typical_density
from slopewatch.interface.parameters import RegionParameters

UTM = CRS.from_epsg(32651)
WHOLE = shapely.Polygon([(5, 5), (55, 8), (60, 30), (35, 30), (33, 45), (8, 42)])
HOLE = shapely.Point(40, 18).buffer(5)


def cloud(fringe=0.12, seed=0):
    """Points of 40/m² in WHOLE without a large hole and a small one; sparse around; a spike and an island."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 65, (40 * 65 * 65, 2))
    inside = shapely.contains_xy(WHOLE.difference(HOLE), *xy.T)
    kept = inside & (np.hypot(*(xy - (18, 20)).T) > 1.5)
    kept |= ~inside & (rng.random(len(xy)) < fringe)
    kept |= (np.abs(xy[:, 1] - 20) < 0.6) & (xy[:, 0] > 55)  # a spike
    kept |= (np.abs(xy - (60, 55)) < 1.6).all(axis=1)  # an island
    return xy[kept]


def proposed(xy, side=1.0, **parameters):
    low, high = xy.min(axis=0), xy.max(axis=0)
    grid = snapped_grid((low[0], low[1], high[0], high[1]), side)
    counts = np.bincount(cell_index(xy, grid), minlength=grid.rows * grid.columns).reshape(grid.shape)
    return suggested_region(counts, grid, UTM, RegionParameters(**parameters))


def test_it_is_the_whole_part():
    xy = cloud()
    region = proposed(xy)
    found, truth = shapely.union_all(region.frame.geometry), WHOLE.difference(HOLE)
    assert found.intersection(truth).area / found.union(truth).area > 0.93
    assert len(region.frame) == 1
    assert found.contains(shapely.Point(18, 20)), "a small hole is filled"
    assert not found.contains(shapely.Point(40, 18))
    assert not found.contains(shapely.Point(60, 55))
    assert not found.contains(shapely.Point(63, 20))
    assert region.frame.loc[0, "density"] == pytest.approx(40, rel=0.08)
    assert region.typical_density == pytest.approx(40, rel=0.1)
    inside = shapely.contains_xy(found, *xy.T)
    assert region.points == pytest.approx(inside.mean(), abs=0.02)
    assert region.sparse > 500
    assert region.thin > 1
    assert region.small == 0 or region.small < 20
    assert "of the cloud's density" in region.frame.loc[0, "reason"]


def test_the_areas_cut_and_kept_add_up():
    region = proposed(cloud(), simplification=0.001)
    kept = region.area
    squares = region.cloud_area - region.sparse - region.thin - region.small
    assert kept == pytest.approx(squares, rel=0.01), "but for the empty squares that holes had"


def test_parameters_do_what_they_say():
    xy = cloud()
    found = {
        name: shapely.union_all(proposed(xy, **given).frame.geometry)
        for name, given in {
            "islands": {"smallest_part": 0.0, "spike_width": 0.0},
            "holes": {"largest_hole": 200.0},
            "no holes": {"largest_hole": 0.0},
            "spikes": {"spike_width": 0.0},
            "all": {"least_density": 0.01},
        }.items()
    }
    assert found["islands"].contains(shapely.Point(60, 55))
    assert found["holes"].contains(shapely.Point(40, 18))
    assert not found["no holes"].contains(shapely.Point(18, 20))
    assert found["all"].area > 1.4 * WHOLE.area
    corners = [
        len(shapely.get_coordinates(proposed(xy, simplification=d).frame.geometry[0])) for d in (0.001, 1.0, 3.0)
    ]
    assert corners[0] > 2 * corners[1] > 2 * corners[2] > 0


def test_the_cloud_s_own_density_is_that_of_most_points():
    counts = np.full((20, 20), 2)
    counts[5:12, 5:15] = 50
    assert typical_density(counts) == 50.0
    assert typical_density(np.array([[0, 4], [4, 4]])) == 4.0


def test_nothing_left_is_an_empty_layer():
    region = proposed(cloud(), spike_width=100.0)
    assert region.frame.empty
    assert region.points == 0.0
    assert region.area == 0.0
