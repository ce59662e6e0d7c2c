"""Scales chosen from clouds whose roughness, density and change are known, and core points spread over them."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.m3c2.scales import choose_scales, overlap_bounds, spread_cores
from slopewatch.interface.parameters import DistanceParameters

DIP = np.radians(40)
NORMAL = np.array([0.0, -np.sin(DIP), np.cos(DIP)])
UTM = np.array([512_000.0, 4_234_000.0, 300.0])


def plane(density, seed, *, noise=0.02, side=20.0):
    """A plane that dips 40 degrees with so many points on a square metre of it."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, side, (2, int(density * side**2)))
    xyz = np.column_stack([u, v * np.cos(DIP), v * np.sin(DIP)])
    return xyz + rng.normal(0, noise, (len(xyz), 1)) * NORMAL + UTM


def test_scales_follow_roughness_density_and_change():
    first, second = plane(120, 1), plane(80, 2)
    second[np.hypot(*(second[:, :2] - UTM[:2] - [10, 7]).T) < 1] -= 0.5 * NORMAL
    scales = choose_scales(first, second, DistanceParameters())
    assert scales.roughness == pytest.approx(0.02, rel=0.1)
    assert scales.normal_scale >= 25 * scales.roughness
    assert scales.normal_scale < 2 * 25 * 0.02  # the first scale that is large enough
    # three quarters of the places are denser than the 25th percentile, a little below the mean of 80
    assert 55 < scales.density < 80
    expected = 80 * np.pi * scales.projection_scale**2 / 4
    assert 25 <= expected < 40
    assert scales.half_length == pytest.approx(1.0, rel=0.25)  # twice the change, though few points show it
    assert scales.core_spacing <= scales.projection_scale / 2
    assert scales.warnings == ()


def test_rougher_ground_gets_a_larger_normal_scale():
    scales = choose_scales(plane(120, 1, noise=0.05), plane(120, 2, noise=0.05), DistanceParameters())
    assert scales.normal_scale >= 25 * 0.045
    assert scales.roughness == pytest.approx(0.05, rel=0.1)


def test_what_is_given_is_kept():
    given = DistanceParameters(normal_scale=1.1, projection_scale=0.77, half_length=3.3, core_spacing=0.21)
    scales = choose_scales(plane(80, 1), plane(80, 2), given)
    assert (scales.normal_scale, scales.projection_scale) == (1.1, 0.77)
    assert (scales.half_length, scales.core_spacing) == (3.3, 0.21)


def test_points_without_a_surface_are_said_to_have_none():
    rng = np.random.default_rng(1)
    first, second = rng.uniform(0, 5, (2, 5000, 3))
    scales = choose_scales(first, second, DistanceParameters())
    assert any("roughness" in sentence for sentence in scales.warnings)


def test_a_few_flying_points_do_not_lengthen_the_cylinder():
    first, second = plane(80, 1), plane(80, 2)
    quiet = choose_scales(first, second, DistanceParameters()).half_length
    first[:10, 2] += 50
    assert choose_scales(first, second, DistanceParameters()).half_length <= 1.5 * quiet


def test_the_same_clouds_give_the_same_scales():
    first, second = plane(80, 1), plane(80, 2)
    assert choose_scales(first, second, DistanceParameters()) == choose_scales(first, second, DistanceParameters())


def test_too_few_points_or_none_in_common():
    with pytest.raises(InputError, match="Fewer than 10 points"):
        choose_scales(plane(80, 1)[:9], plane(80, 2), DistanceParameters())
    with pytest.raises(InputError, match=r"x 512000\.0 to 512020\.0.*x 512100\.0 to"):
        overlap_bounds(plane(20, 1), plane(20, 2) + [100, 0, 0])
    with pytest.raises(InputError, match="--half-length"):
        choose_scales(plane(20, 1), plane(20, 2) - 5 * NORMAL, DistanceParameters(half_length=0.5))


def test_one_core_point_in_each_cube_the_nearest_to_its_middle():
    cloud = plane(50, 1)
    west, south, east, north = bounds = overlap_bounds(cloud, cloud - [4, 0, 0])
    chosen = spread_cores(cloud, 0.5, bounds)
    inside = (cloud[:, 0] >= west) & (cloud[:, 0] <= east) & (cloud[:, 1] >= south) & (cloud[:, 1] <= north)
    cubes = {}
    for number in np.flatnonzero(inside):
        cubes.setdefault(tuple(np.floor(cloud[number] / 0.5 + 1e-6).astype(int)), []).append(number)
    expected = set()
    for members in cubes.values():
        away = np.linalg.norm(cloud[members] - cloud[members].mean(axis=0), axis=1)
        expected.add(members[int(np.argmin(away))])
    assert set(np.flatnonzero(chosen)) == expected
