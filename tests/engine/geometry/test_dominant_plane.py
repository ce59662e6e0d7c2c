"""The dominant plane and the rotation that lays it flat, against known planes and against scipy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.dominant_plane import (
    Plane,
    apply_matrix,
    fit_plane,
    flattening_matrix,
    lowest_points,
    rotation_to_vertical,
    unflattening_matrix,
)

ORIGIN = np.array([500_123.4, 3_500_987.6, 321.0])


def normal_of(dip: float, azimuth: float) -> np.ndarray:
    d, a = np.radians([dip, azimuth])
    return np.array([np.sin(d) * np.sin(a), np.sin(d) * np.cos(a), np.cos(d)])


def points_on_plane(normal: np.ndarray, count: int, noise: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    along = np.cross(normal, [0.3, 0.1, 0.9])
    along /= np.linalg.norm(along)
    across = np.cross(normal, along)
    place = rng.uniform(-20, 20, (count, 2))
    return place[:, :1] * along + place[:, 1:] * across + rng.normal(0, noise, (count, 1)) * normal + ORIGIN


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


@pytest.mark.parametrize(("dip", "azimuth"), [(0.0, 0.0), (39.0, 150.0), (63.0, 271.0), (85.0, 10.0)])
def test_a_known_plane_is_found_among_points_that_are_not_on_it(dip, azimuth):
    normal = normal_of(dip, azimuth)
    ground = points_on_plane(normal, 3000, 0.03)
    rng = np.random.default_rng(1)
    plants = points_on_plane(normal, 2500, 0.0, seed=2) + rng.uniform(0.5, 6.0, (2500, 1)) * normal
    stray = np.array([[*ORIGIN[:2], -1e6], [*ORIGIN[:2], 1e5]])
    plane = fit_plane(np.vstack([ground, plants, stray]), 0.1, 500, seed=3)
    assert angle_between(plane.normal, normal) < 0.05
    assert abs((plane.centroid - ORIGIN) @ normal) < 0.01
    assert plane.dip == pytest.approx(dip, abs=0.05)
    if dip:
        assert plane.azimuth == pytest.approx(azimuth, abs=0.1)
    assert 0.5 < plane.inlier_share < 0.6


def test_the_same_seed_gives_the_same_plane_and_principal_components_settle_the_rest():
    points = points_on_plane(normal_of(40, 100), 4000, 0.05)
    first, again, other = (fit_plane(points, 0.2, 200, seed=s) for s in (1, 1, 2))
    assert np.array_equal(first.normal, again.normal)
    assert np.array_equal(first.centroid, again.centroid)
    assert angle_between(first.normal, other.normal) < 0.02


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        ORIGIN[None].repeat(2, 0),
        ORIGIN + np.arange(50.0)[:, None] * [1, 2, 3],
        ORIGIN[None].repeat(9, 0),
    ],
    ids=["none", "two", "on a line", "all the same"],
)
def test_points_without_a_plane_are_refused(points):
    with pytest.raises(InputError, match="plane"):
        fit_plane(points, 0.1, 100, seed=0)


@pytest.mark.parametrize(("dip", "azimuth"), [(0.0, 0.0), (1e-9, 5.0), (39.0, 150.0), (89.9, 271.0)])
def test_the_rotation_is_rodrigues_about_a_horizontal_axis(dip, azimuth):
    normal = normal_of(dip, azimuth)
    rotation = rotation_to_vertical(normal)
    axis = np.cross(normal, [0, 0, 1])
    length = np.linalg.norm(axis)
    expected = Rotation.from_rotvec(axis / length * np.arcsin(length) if length else axis).as_matrix()
    assert np.allclose(rotation, expected, atol=1e-12)
    assert np.allclose(rotation @ normal, [0, 0, 1], atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_flattening_and_back_keeps_large_coordinates_to_a_nanometre():
    normal = normal_of(39, 150)
    points = points_on_plane(normal, 5000, 2.0) + [0, 3_000_000, 0]
    plane = Plane(normal, points.mean(axis=0), 1.0)
    flat = apply_matrix(flattening_matrix(plane), points)
    assert np.allclose(flat.mean(axis=0), 0, atol=1e-6)
    assert np.allclose(flat[:, 2], (points - plane.centroid) @ normal, atol=1e-8)
    assert np.abs(apply_matrix(unflattening_matrix(plane), flat) - points).max() < 2e-9
    assert np.allclose(unflattening_matrix(plane) @ flattening_matrix(plane), np.eye(4), atol=1e-9)


def test_lowest_points_are_those_of_a_plain_loop():
    points = np.random.default_rng(4).uniform(0, 10, (500, 3)) + ORIGIN
    lowest: dict[tuple[int, int], np.ndarray] = {}
    for p in points:
        cell = tuple(np.floor((p[:2] - points[:, :2].min(axis=0)) / 2.0).astype(int))
        if cell not in lowest or p[2] < lowest[cell][2]:
            lowest[cell] = p
    found = lowest_points(points, 2.0)
    assert sorted(map(tuple, found)) == sorted(map(tuple, lowest.values()))
