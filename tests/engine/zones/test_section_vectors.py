"""Displacement vectors in the plane of a section, compared with rotations by hand."""

from __future__ import annotations

from itertools import pairwise

import geopandas as gpd
import numpy as np
import pytest
from shapely.geometry import LineString
from slopewatch.engine.zones.section_vectors import vectors_near


def layer(places, motions, window: float = 5.0) -> gpd.GeoDataFrame:
    """Vectors with ``motions`` (n, 3) at ``places`` (n, 2)."""
    east, north, up = np.asarray(motions, dtype=float).T
    table = {"east_m": east, "north_m": north, "up_m": up, "window_m": window}
    return gpd.GeoDataFrame(table, geometry=gpd.points_from_xy(*np.asarray(places, dtype=float).T), crs=32651)


def test_a_motion_is_split_along_the_line_and_out_of_it():
    turn = np.radians(30.0)
    along, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    start = np.array([500_000.0, 3_000_000.0])
    line = LineString([start, start + 40 * along])
    rng = np.random.default_rng(4)
    at, off = rng.uniform(1, 39, 25), rng.uniform(-2.4, 2.4, 25)
    parts = rng.normal(0, 0.2, (25, 3))
    level = parts[:, :1] * along + parts[:, 1:2] * left
    near = vectors_near(line, layer(start + at[:, None] * along + off[:, None] * left, np.c_[level, parts[:, 2]]))
    order = np.argsort(at)
    for found, true in (
        (near.distance, at),
        (near.along, parts[:, 0]),
        (near.across, parts[:, 1]),
        (near.up, parts[:, 2]),
    ):
        np.testing.assert_allclose(found, true[order], atol=1e-6)


def test_only_what_lies_within_half_a_window_and_between_the_ends_counts():
    line = LineString([(0, 0), (10, 0)])
    places = [(2, 2.4), (4, 2.6), (-1, 0), (11, 1), (10, 0), (6, -2.5)]
    near = vectors_near(line, layer(places, np.tile([0.1, 0.0, 0.0], (6, 1))))
    assert near.distance.tolist() == [2.0, 6.0]
    assert len(vectors_near(line, layer(places, np.tile([0.1, 0.0, 0.0], (6, 1)), window=8.0))) == 3


def test_a_bent_line_has_its_own_direction_at_each_place():
    line = LineString([(0, 0), (10, 0), (10, 10)])
    near = vectors_near(line, layer([(3, 0.1), (10.1, 7)], [(0.2, 0.05, -0.1), (0.2, 0.05, -0.1)]))
    np.testing.assert_allclose(near.distance, [3, 17])
    np.testing.assert_allclose(near.along, [0.2, 0.05], atol=1e-9)
    np.testing.assert_allclose(near.across, [0.05, -0.2], atol=1e-9)


def test_without_vectors_there_are_none():
    empty = layer(np.zeros((0, 2)), np.zeros((0, 3)))
    assert len(vectors_near(LineString([(0, 0), (1, 0)]), empty)) == 0


@pytest.mark.parametrize("window", [2.0, 5.0])
def test_the_same_by_brute_force(window: float):
    rng = np.random.default_rng(8)
    corners = np.cumsum(rng.uniform(1, 6, (5, 2)), axis=0)
    places = rng.uniform(0, 25, (200, 2))
    near = vectors_near(LineString(corners), layer(places, np.tile([0.0, 0.0, 0.1], (200, 1)), window=window))
    fine = np.concatenate([np.linspace(a, b, 4000) for a, b in pairwise(corners)])
    away = np.array([np.hypot(*(fine - place).T).min() for place in places])
    first = [np.hypot(*(fine - place).T).argmin() for place in places]
    inside = (away <= window / 2) & (np.array(first) > 0) & (np.array(first) < len(fine) - 1)
    assert abs(len(near) - int(inside.sum())) <= 1
    assert len(near) > 5
