"""Cover, gaps and transmission of the canopy against counting and the Beer-Lambert law."""

from __future__ import annotations

import math

import numpy as np
import pytest
from slopewatch.simulation.fields import HeightField
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.sources import GROUND, LEAVES, TURF
from slopewatch.simulation.surveys.layers import Landscape
from slopewatch.simulation.surveys.returns import echoes
from slopewatch.simulation.surveys.scene import Relief, Scene, build_scene, cut_profile
from slopewatch.simulation.surveys.vegetation import DENSITY_UNIT, Canopy, grow
from slopewatch.simulation.trace import Rays


def make_scene(angle: float = 39.0, turf: float = 0.02) -> Scene:
    relief = Relief(turf_height=turf)
    rng = np.random.default_rng(4)
    return build_scene(cut_profile(12.0, angle, 0), (0.0, 0.0, 25.0, 15.0), 5.0, Frame(), relief, rng)


@pytest.mark.parametrize("cover", [0.3, 0.7, 0.9])
def test_share_of_ground_under_leaves_seen_from_above(cover):
    scene = make_scene()
    canopy = grow(scene, cover, np.random.default_rng(5))
    u0, _v0, u1, v1 = scene.slope
    u, v = np.random.default_rng(6).uniform((u0, 0.5), (u1, v1), (4000, 2)).T
    ground = scene.height(u, v)
    above = np.arange(0.05, 12.0, 0.05)
    leaves = canopy.density_at(*np.broadcast_arrays(u[:, None], v[:, None], ground[:, None] + above))
    assert (leaves > 0).any(axis=1).mean() == pytest.approx(cover, abs=0.03)
    # Gaps: not every pulse that meets a crown is stopped.
    depth = leaves.sum(axis=1) * 0.05
    assert 0.05 < np.exp(-depth[depth > 0]).mean() < 0.4


def test_no_vegetation_asked_for():
    canopy = grow(make_scene(), 0.0, np.random.default_rng(1))
    assert not canopy.density.any()
    assert not canopy.covered.any()


def flat(depth: float, density: float) -> tuple[Scene, Canopy]:
    """Level ground under an even layer of leaves from 1 m to 1 + ``depth`` m."""
    scene = make_scene(turf=0.0)
    field = HeightField(-50.0, -50.0, 1.0, np.zeros((101, 101)))
    profile = cut_profile(1e-6, 45.0, 0)
    scene = Scene(scene.frame, profile, field, HeightField(-50.0, -50.0, 1.0, np.zeros((101, 101))), (-9, -9, 9, 9))
    layers = 40
    counts = np.zeros((100, 100, layers), np.uint8)
    counts[:, :, 10 : 10 + round(depth / 0.1)] = round(density / DENSITY_UNIT)
    ones = np.ones((100, 100))
    top = ones * (1.0 + depth)
    return scene, Canopy(-50.0, -50.0, 0.0, 1.0, 0.1, 0.15, counts, np.zeros(100), top, ones > 0)


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_share_of_rays_that_meet_no_leaf_follows_beer_lambert(angle):
    depth, density, n = 1.5, 0.8, 40_000
    scene, canopy = flat(depth, density)
    sine, cosine = math.sin(math.radians(angle)), math.cos(math.radians(angle))
    rays = Rays(np.tile([[0.0], [0.0], [20.0]], n), np.tile([[sine], [0.0], [-cosine]], n))
    rng = np.random.default_rng(2)
    found = echoes(Landscape(scene, canopy), rays, np.zeros(n), np.full(n, 20.0 / cosine), 5, rng)
    struck = np.unique(found.ray[found.source == LEAVES])
    assert 1 - len(struck) / n == pytest.approx(math.exp(-density * depth / cosine), abs=0.012)
    height = 20.0 - found.distance[found.source == LEAVES] * cosine
    assert height.min() > 1.0 - 0.15
    assert height.max() < 1.0 + depth + 0.15
    # Echoes thin out downwards, because rays end on their way.
    assert np.median(height[:]) > 1.0 + depth / 2


def test_echoes_of_a_ray_are_ordered_apart_and_few():
    scene, canopy = flat(2.5, 2.0)
    n = 20_000
    rays = Rays(np.tile([[0.0], [0.0], [20.0]], n), np.tile([[0.0], [0.0], [-1.0]], n))
    found = echoes(Landscape(scene, canopy), rays, np.zeros(n), np.full(n, 20.0), 5, np.random.default_rng(3))
    same = np.diff(found.ray) == 0
    assert (np.diff(found.ray) >= 0).all()
    assert (np.diff(found.distance)[same] >= 0.25).all()
    assert 3 <= np.bincount(found.ray).max() <= 5
    energy = np.bincount(found.ray, found.energy)
    assert energy.max() <= 1.0 + 1e-9
    limited = echoes(Landscape(scene, canopy), rays, np.zeros(n), np.full(n, 20.0), 2, np.random.default_rng(3))
    assert np.bincount(limited.ray).max() == 2


def test_grass_stands_on_the_ground_and_not_on_the_road():
    scene = make_scene()
    u, v = np.random.default_rng(8).uniform((0, -4), (25, 15), (20_000, 2)).T
    ground = scene.height(u, v)
    rays = Rays(np.stack([u, v, np.full(len(u), 60.0)]), np.tile([[0.0], [0.0], [-1.0]], len(u)))
    bare = grow(scene, 0.0, np.random.default_rng(1))
    found = echoes(Landscape(scene, bare), rays, np.zeros(len(u)), 60.0 - ground, 5, np.random.default_rng(9))
    above = 60.0 - found.distance - ground[found.ray]
    grass = found.source == TURF
    assert above[found.source == GROUND] == pytest.approx(0.0, abs=1e-9)
    assert 0.05 < grass.mean() < 0.5
    assert above[grass].min() >= 0
    assert 0.03 < above[grass].max() < 0.06
    assert v[found.ray[grass]].min() > -0.3
