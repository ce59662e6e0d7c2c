"""The outline of the relief: inclined planes stay, trees and houses are cut off, ridges stay."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.ground.densification import densified
from slopewatch.engine.ground.layered_ground import layered_ground
from slopewatch.engine.ground.relief import relief
from slopewatch.engine.ground.surface_heights import outline_of, surface_heights
from slopewatch.tests.builders.ground_shapes import jittered_grid

SIDE = 50.0


@pytest.fixture(scope="module")
def places() -> np.ndarray:
    return jittered_grid(SIDE, 0.5)


def outline(points: np.ndarray) -> np.ndarray:
    return relief(points, len(points)).at(points)


def inner(xy: np.ndarray) -> np.ndarray:
    return (np.abs(xy - SIDE / 2) < SIDE / 2 - 6.0).all(axis=1)


def test_an_inclined_plane_is_its_own_outline(places):
    height = 0.25 * places[:, 0] - 0.15 * places[:, 1]
    found = (outline(np.column_stack([places, height])) - height)[inner(places)]
    # the lowest of the points of a square lies at most half of its diagonal down the plane
    assert found.min() > -0.25
    assert found.max() < 0.1


def test_a_house_and_a_crown_are_cut_off_and_a_ridge_stays(places):
    house = (np.abs(places - [15.0, 25.0]) < 5.0).all(axis=1)
    crown = np.hypot(*(places - [15.0, 40.0]).T) < 3.0
    ridge = np.clip(3.0 - 0.4 * np.abs(places[:, 0] - 37.0), 0.0, None)
    points = np.column_stack([places, ridge + np.where(house, 6.0, 0.0) + np.where(crown, 9.0, 0.0)])
    found = outline(points)
    assert np.abs(found[house | crown]).max() < 0.5
    assert np.abs(found - ridge)[inner(places)].max() < 1.0


def test_the_outline_of_parts_is_that_of_the_whole(places):
    height = 2.0 * np.sin(places[:, 0] / 4) * np.cos(places[:, 1] / 5)
    points, west = np.column_stack([places, height]), places[:, 0] < 12.3
    origin = points.min(axis=0)
    whole, parts = outline_of([points], origin), outline_of([points[west], points[~west]], origin)
    assert parts.at(points) == pytest.approx(whole.at(points), abs=1e-9)


def test_single_returns_of_rough_ground_are_ground_and_what_stands_on_it_is_not(places):
    """A point a metre: ground 0.3 m rough under bushes 1.5 to 3 m high, too few for any surface through others."""
    rng = np.random.default_rng(5)
    xy = jittered_grid(SIDE, 1.0)
    bush = rng.random(len(xy)) < 0.3
    over = rng.normal(0.0, 0.15, len(xy)) + np.where(bush, rng.uniform(1.5, 3.0, len(xy)), 0.0)
    every = np.ones(len(xy), dtype=bool)
    result = layered_ground(np.column_stack([xy, over]), every, every, 0.05)
    found = result.ground
    assert found[~bush].mean() > 0.9
    assert found[bush].mean() < 0.1
    # the stated error is that of heights which are taken alike within the threshold, and covers the roughness
    assert result.plant_error[found] == pytest.approx(result.threshold / np.sqrt(3.0))
    assert result.plant_error[found].min() > over[~bush].std()


def test_a_wide_low_roof_is_no_ground_of_single_returns():
    xy = jittered_grid(90.0, 1.0)
    roof = (np.abs(xy - 45.0) < 15.0).all(axis=1)
    every = np.ones(len(xy), dtype=bool)
    found = layered_ground(np.column_stack([xy, np.where(roof, 3.0, 0.0)]), every, every, 0.05).ground
    assert found[~roof].mean() > 0.98
    assert found[roof].mean() < 0.02


def test_an_error_of_ranging_takes_no_ground_away_around_it(places):
    """A return 20 m below the others in every 12 m: a window's opening would go down to it."""
    xy = places[::4]
    pit = (np.abs(xy % 12.0 - 6.0) < 0.5).all(axis=1)
    found = outline(np.column_stack([xy, np.where(pit, -20.0, 0.0)]))
    assert pit.any()
    assert np.abs(found).max() < 0.1


def test_dense_clouds_have_no_outline(places):
    points = np.column_stack([np.tile(places, (20, 1)), np.zeros(20 * len(places))])
    assert outline_of([points]) is None
    assert outline_of([points[::10]]) is not None


def test_hills_of_a_forest_are_found_under_sparse_returns():
    """Of hills every 16 m under trees, with a ground return a m², triangles alone reach an eighth."""
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, SIDE, (round(SIDE**2) * 6, 2))
    hills = 2.0 * np.sin(xy[:, 0] * (2 * np.pi / 16.0)) * np.cos(xy[:, 1] * (2 * np.pi / 16.0))
    tree = rng.random(len(xy)) < 0.85
    over = rng.normal(0, 0.03, len(xy)) + np.where(tree, rng.uniform(0.5, 12.0, len(xy)), 0.0)
    every = np.ones(len(xy), dtype=bool)
    found = np.abs(surface_heights(np.column_stack([xy, hills + over]), every, every).height) < 0.15
    assert found[~tree].mean() > 0.3
    assert found[tree].mean() < 0.01


def test_points_farther_apart_may_bend_more():
    """Ground that scatters by 0.35 m beside level ground: as steep between points 1.5 m apart it is natural."""
    found = []
    for step in (0.5, 1.5):
        xy = jittered_grid(40.0, step)
        height = np.where(xy[:, 0] > 20.0, np.random.default_rng(1).normal(0.0, 0.35, len(xy)), 0.0)
        ground = densified(np.column_stack([xy, height]))
        found.append(ground[xy[:, 0] > 20.0].mean())
    assert found[1] > 1.3 * found[0]
