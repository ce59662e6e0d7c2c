"""Planes of a surface against a plane fit by singular values among brute-force neighbours."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.registration.surface import NEIGHBOURS, Surface, nearest


def bumpy(n: int = 3000, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 5, (2, n))
    return np.column_stack([x, y, 0.4 * y + 0.1 * np.sin(2 * x) + rng.normal(0, 0.005, n)])


def test_planes_are_those_of_the_nearest_points():
    surface = Surface(bumpy(), 0.1)
    chosen = surface.sample(50)
    surface.fit(chosen)
    for number in chosen:
        distance = np.linalg.norm(surface.points - surface.points[number], axis=1)
        near = surface.points[np.argsort(distance)[:NEIGHBOURS]]
        normal = np.linalg.svd(near - near.mean(axis=0))[2][2]
        assert np.abs(surface.centroids[number] - near.mean(axis=0)).max() < 1e-12
        assert surface.normals[number] @ (normal * np.sign(normal[2])) > 1 - 1e-9  # upwards


def test_a_cloud_without_surface_has_no_planes():
    filled = Surface(np.random.default_rng(0).uniform(0, 2, (4000, 3)), 0.1)
    smooth = Surface(bumpy(), 0.1)
    shares = []
    for surface in (filled, smooth):
        surface.fit(np.arange(len(surface.points)))
        shares.append(surface.planar.mean())
    assert shares[0] < 0.5 < 0.95 < shares[1]


def test_spacing_is_that_of_a_lattice():
    x, y = np.meshgrid(np.arange(0, 10, 0.25), np.arange(0, 10, 0.25))
    surface = Surface(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), 0.1)
    assert 0.8 * 0.25 < surface.spacing < 1.4 * 0.25


def test_nearest_is_brute_force_within_reach():
    reference, asked = bumpy(500, 1), bumpy(200, 2) + [0.0, 0.0, 0.05]
    surface = Surface(reference, 0.001)
    distances = np.linalg.norm(asked[:, None] - surface.points[None], axis=2)
    distance, number = nearest(surface.tree, asked, 0.15)
    within = distances.min(axis=1) < 0.15
    assert 0 < within.sum() < len(asked)
    assert np.array_equal(np.isfinite(distance), within)
    assert np.array_equal(number[within], distances.argmin(axis=1)[within])


def test_a_sample_is_always_the_same_and_within_what_is_eligible():
    surface = Surface(bumpy(), 0.1)
    eligible = surface.points[:, 0] < 2
    assert np.array_equal(surface.sample(100, eligible), surface.sample(100, eligible))
    assert eligible[surface.sample(100, eligible)].all()
    assert len(np.unique(surface.sample(100))) == 100


def test_a_smaller_sample_is_part_of_a_larger_one():
    surface = Surface(bumpy(), 0.1)
    assert np.isin(surface.sample(50), surface.sample(200)).all()


def test_ground_is_as_bare_after_its_planes_were_fitted_as_before():
    xyz = bumpy()
    plants = np.where(xyz[:, 0] < 2.5, 0.0, 0.05)
    asked, fitted = (Surface(xyz, 0.1, plants) for _ in range(2))
    fitted.fit(np.arange(0, len(fitted.points), 2))
    before = len(fitted.points)
    expected = asked.bare(0.01)
    for number in range(0, before, 7):
        distance = np.linalg.norm(asked.points - asked.points[number], axis=1)
        assert expected[number] == (asked.plants[np.argsort(distance)[:NEIGHBOURS]] <= 0.01).all()
    assert 0.3 < expected.mean() < 0.5
    assert np.array_equal(fitted.bare(0.01), expected)
