"""Kernels of the registration: compiled and plain ways alike to the last bit, and right by all distances and planes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slopewatch.engine.core.compiled import compiled_loop
from slopewatch.engine.registration import kernels

KERNELS = (kernels.kept_neighbours, kernels.neighbourhood_moments, kernels.plane_pairs)


def both(kernel, *arguments) -> tuple:
    """What the plain way finds, which the loop must find too, as Python runs it and as numba compiles it."""
    plain = kernel.plain(*arguments)
    for way in (kernel.loop, compiled_loop(kernel.loop)):
        if way is not None:
            found = way(*arguments)
            for one, other in zip(_tuple(found), _tuple(plain), strict=True):
                assert np.array_equal(one, other), way
    return plain


def _tuple(value):
    return value if isinstance(value, tuple) else (value,)


def surface(rng: np.random.Generator, count: int) -> kernels.Planes:
    normals = rng.normal([0.0, 0.0, 2.0], 0.4, (count, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = rng.uniform(0, 10, (count, 3))
    return kernels.as_planes(points, points + rng.normal(0, 0.05, (count, 3)), normals, rng.random(count) < 0.8)


@pytest.mark.parametrize("first_moves", [True, False])
def test_pairs_are_distances_along_the_mean_normal(first_moves):
    rng = np.random.default_rng(3)
    first, second = surface(rng, 400), surface(rng, 300)
    sources, number = rng.permutation(400)[:350], rng.integers(0, 300, 350)
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    motion = turn, np.array([0.5, -1.0, 2.0])
    place, normal, residual, gap, kept = both(
        kernels.plane_pairs, sources, number, (first, second), motion, first_moves, 0.8
    )
    points, centres, normals, planar = first
    _, middles, others, flat = second
    if first_moves:
        points, centres, normals = points @ turn.T + motion[1], centres @ turn.T + motion[1], normals @ turn.T
    else:
        middles, others = middles @ turn.T + motion[1], others @ turn.T
    agree = np.abs(np.einsum("ij,ij->i", normals[sources], others[number])) > 0.8
    wanted = np.flatnonzero(agree & planar[sources] & flat[number])
    assert 50 < len(wanted) < 300
    assert np.array_equal(kept, sources[wanted])
    a, b = sources[wanted], number[wanted]
    assert np.allclose(place, points[a], atol=1e-12)
    assert np.allclose(np.linalg.norm(normal, axis=1), 1.0)
    assert np.allclose(np.cross(normal, normals[a] + others[b]), 0.0, atol=1e-12)  # all look upwards
    assert np.allclose(residual, np.einsum("ij,ij->i", points[a] - middles[b], normal), atol=1e-12)
    assert np.allclose(gap, np.einsum("ij,ij->i", (points[a] + centres[a]) / 2 - middles[b], normal), atol=1e-12)


@pytest.mark.parametrize("count", [60, 1])
def test_moments_are_those_of_the_points_around(count):
    rng = np.random.default_rng(4)
    points = rng.uniform(0, 5, (200, 3)) + [500_000.0, 0.0, 0.0]
    numbers = rng.permutation(200)[:count]
    near = rng.integers(0, 200, (count, 12))
    found = both(kernels.neighbourhood_moments, points, numbers, near)
    for i, group in enumerate(near):
        covariance = np.cov(points[group].T, bias=True) * 12
        assert np.allclose(found[:3, i], points[group].mean(axis=0))
        assert np.allclose(found[3:, i], covariance[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], atol=1e-8)


def test_neighbours_that_are_called_sure_are_the_nearest_of_all():
    rng = np.random.default_rng(5)
    points, looked = rng.uniform(0, 1, (300, 3)), rng.uniform(-0.1, 1.1, (500, 3))
    away = np.linalg.norm(looked[:, None] - points[None], axis=2)
    order = np.argsort(away, axis=1)
    sorted_away = np.take_along_axis(away, order, axis=1)
    near = order[:, :3].copy()
    none = sorted_away[:, :3] > 0.15  # nothing was looked for farther away
    near[none] = len(points)
    beyond = np.minimum(sorted_away[:, 3], 0.15)
    slack = np.where(none[:, 0], 0.15, (np.minimum(sorted_away[:, 1], 0.15) - sorted_away[:, 0]) / 2)
    which = rng.permutation(500)[:400]
    places = looked[which] + rng.normal(0, 0.02, (400, 3))
    distance, number, sure = both(kernels.kept_neighbours, points, (looked, near, slack, beyond), which, places, 0.1)
    all_away = np.linalg.norm(places[:, None] - points[None], axis=2)
    nearest = np.where(all_away.min(axis=1) < 0.1, all_away.argmin(axis=1), len(points))
    kept = number == near[which, 0]
    assert 150 < np.count_nonzero(sure) < 400
    assert np.count_nonzero(sure & ~kept & (number < len(points))) > 10  # the second or third candidate
    assert np.array_equal(number[sure], nearest[sure])
    found = sure & (number < len(points))
    assert np.allclose(distance[found], all_away.min(axis=1)[found], atol=1e-12)


def test_kernels_compile_where_numba_is():
    pytest.importorskip("numba")
    assert all(compiled_loop(kernel.loop) is not None for kernel in KERNELS)
