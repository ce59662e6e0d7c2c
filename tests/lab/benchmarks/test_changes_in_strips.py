"""Patches put into strips, and how a run is held against them."""

from __future__ import annotations

import geopandas as gpd
import numpy as np
import pytest
import rasterio
import shapely
from slopewatch.lab.benchmarks.changes_in_strips import _found, _zones_sign
from slopewatch.lab.benchmarks.patches import Patch, placed, total_rise


def test_a_patch_is_highest_in_its_middle_and_half_as_high_at_half_of_its_radius() -> None:
    patch = Patch(10.0, 20.0, 4.0, -0.5)
    rise = total_rise([patch], np.array([[10.0, 20.0, 3.0], [12.0, 20.0, 9.0], [10.0, 24.0, 0.0], [30.0, 20.0, 0.0]]))
    assert rise == pytest.approx([-0.5, -0.25, 0.0, 0.0])


def test_patches_lie_apart_and_over_ground_of_both_surveys() -> None:
    random = np.random.default_rng(3)
    west, east = random.uniform(0, 40, (2, 4000, 3))
    east[:, 0] += 15.0
    patches = placed([(0.5, 3.0)] * 4, [west, east], random, gap=2.0)
    assert len(patches) == 4
    assert all(18.0 <= patch.east <= 37.0 for patch in patches)
    middles = np.array([[patch.east, patch.north] for patch in patches])
    apart = np.hypot(*(middles[:, None] - middles).transpose(2, 0, 1))
    assert apart[np.triu_indices(4, 1)].min() > 8.0


def test_patches_lie_within_a_turned_slope() -> None:
    random = np.random.default_rng(4)
    ground = random.uniform(0, 40, (4000, 3))
    slope = shapely.Polygon([(20, 0), (40, 20), (20, 40), (0, 20)])
    patches = placed([(0.5, 2.0)] * 6, [ground], random, 1.0, slope)
    assert len(patches) == 6
    assert all(slope.contains(shapely.Point(patch.east, patch.north).buffer(1.9)) for patch in patches)


def test_nothing_moves_beyond_a_patch() -> None:
    assert Patch(0.0, 0.0, 2.0, 0.3).rise(np.array([[3.0, 0.0], [0.0, 2.0]])).tolist() == [0.0, 0.0]


def test_only_a_zone_of_the_patchs_own_sign_over_half_of_its_middle_finds_it() -> None:
    transform = rasterio.transform.from_origin(0.0, 20.0, 0.5, 0.5)
    change = np.full((40, 40), -0.3)
    columns, rows = np.meshgrid(np.arange(40) + 0.5, np.arange(40) + 0.5)
    middles = np.column_stack(transform @ (columns.ravel(), rows.ravel()))

    def found(shape: shapely.Geometry, height: float) -> bool:
        zones = gpd.GeoDataFrame(geometry=[shape], crs=6677)
        return _found(Patch(10.0, 10.0, 4.0, height), middles, _zones_sign(zones, change, transform))

    assert found(shapely.box(8.5, 7.0, 13.0, 13.0), -0.3)
    assert not found(shapely.box(8.5, 7.0, 13.0, 13.0), 0.3)
    assert not found(shapely.box(10.6, 7.0, 13.0, 13.0), -0.3)
