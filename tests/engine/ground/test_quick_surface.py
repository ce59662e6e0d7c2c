"""The quick surface under a raw cloud: on the ground between plants, at an edge, and not at a stray point."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.grid.grid import snapped_grid
from slopewatch.engine.ground.quick_surface import LowestReturns, quick_surface

BASE = 40.0


def slope(x, y):
    """A road, a face of 40 degrees, and a shoulder of 6."""
    return 50 + np.clip(y - 8, 0, 14) * np.tan(np.radians(40)) + np.clip(y - 22, 0, None) * np.tan(np.radians(6))


@pytest.fixture(scope="module")
def cloud():
    """Ground with shrubs on half of it, and a point 6 m below."""
    rng = np.random.default_rng(3)
    xy = rng.uniform((0, 0), (40, 30), (90_000, 2))
    z = slope(*xy.T) + rng.normal(0, 0.02, len(xy))
    shrub = (np.sin(xy[:, 0]) * np.sin(xy[:, 1] * 0.8) > 0.1) & (rng.random(len(xy)) < 0.93)
    z[shrub] += rng.uniform(0.4, 2.0, shrub.sum())
    xyz = np.column_stack([xy, z])
    stray = [[20.0, 15.0, slope(20.0, 15.0) - 6.0]]
    return np.concatenate([xyz, stray]), shrub


def surface_of(xyz, parts=1):
    lows = LowestReturns(snapped_grid((0, 0, 40, 30), 0.2), BASE, 0.12)
    for part in np.array_split(xyz, parts):
        lows.add(part)
    return quick_surface(lows)


def test_it_lies_on_the_ground_between_plants(cloud):
    xyz, shrub = cloud
    over = xyz[:-1, 2] - BASE - surface_of(xyz).at(xyz[:-1])
    error = over[~shrub]
    assert abs(np.median(error)) < 0.08
    assert np.mean(np.abs(error) < 0.2) > 0.97
    assert np.mean(np.abs(over[shrub]) < 0.2) < 0.1


def test_it_bends_with_the_ground_and_not_at_a_stray_point(cloud):
    xyz, _ = cloud
    y = np.arange(1.0, 29.0, 0.1)
    for x in (7.0, 20.0):
        places = np.column_stack([np.full_like(y, x), y])
        error = surface_of(xyz).at(places) + BASE - slope(*places.T)
        assert np.abs(error).max() < 0.35, x


def test_it_does_not_depend_on_the_parts(cloud):
    xyz, _ = cloud
    np.testing.assert_array_equal(surface_of(xyz).height, surface_of(xyz, 7).height)


def test_ground_points_alone_are_followed_over_gaps():
    rng = np.random.default_rng(1)
    xy = rng.uniform((0, 0), (40, 30), (4_000, 2))
    xy = xy[(xy[:, 0] < 12) | (xy[:, 0] > 22)]
    lows = LowestReturns(snapped_grid((0, 0, 40, 30), 0.5), 0.0, 0.3)
    lows.add(np.column_stack([xy, 5 + 0.6 * xy[:, 0] - 0.2 * xy[:, 1]]))
    places = np.array([[17.0, 10.0], [15.0, 20.0], [3.0, 3.0]])
    found = quick_surface(lows, plants=False).at(places)
    np.testing.assert_allclose(found, 5 + 0.6 * places[:, 0] - 0.2 * places[:, 1], atol=0.01)


def test_a_single_point_is_enough():
    lows = LowestReturns(snapped_grid((0, 0, 3, 3), 0.5), 0.0, 0.3)
    lows.add(np.array([[1.0, 1.0, 7.0]]))
    np.testing.assert_allclose(quick_surface(lows).at(np.array([[0.2, 2.8]])), 7.0)
