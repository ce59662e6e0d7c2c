"""A beam's way through closed layers against the Beer-Lambert law."""

from __future__ import annotations

import math

import numpy as np
import pytest
from slopewatch.simulation.fields import HeightField
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.sources import GROUND, LEAVES, TURF
from slopewatch.simulation.surveys.layers import Cover, Crossing, Landscape, Layer
from slopewatch.simulation.surveys.returns import SEPARATION, echoes
from slopewatch.simulation.surveys.scene import Scene, cut_profile
from slopewatch.simulation.surveys.vegetation import Canopy
from slopewatch.simulation.trace import Rays

HEIGHT, DEPTH = 0.8, 1.5


def layer(height: float = HEIGHT, depth: float = DEPTH, source: int = TURF) -> Layer:
    ones = np.ones((200, 200), np.float32)
    return Layer((-100.0, -100.0), 1.0, ones * height, ones * depth, np.ones(65, np.float32), source)


def level() -> tuple[Scene, Canopy]:
    """Level ground at height 0 without turf; no leaves."""
    flat = HeightField(-100.0, -100.0, 1.0, np.zeros((201, 201)))
    nothing = np.zeros((2, 2))
    canopy = Canopy(
        0.0, 0.0, 0.0, 1.0, 0.1, 0.15, np.zeros((2, 2, 1), np.uint8), nothing[0], nothing - 1e6, nothing > 0
    )
    return Scene(Frame(), cut_profile(1e-6, 45.0, 0), flat, flat, (-9.0, -9.0, 9.0, 9.0)), canopy


def beams(angle: float, count: int = 30_000) -> tuple[Rays, np.ndarray, np.ndarray]:
    """Parallel beams, how far above the layers they start, and how far the ground is."""
    sine, cosine = math.sin(math.radians(angle)), math.cos(math.radians(angle))
    rays = Rays(np.tile([[0.0], [0.0], [20.0]], count), np.tile([[sine], [0.0], [-cosine]], count))
    return rays, np.full(count, 18.0 / cosine), np.full(count, 20.0 / cosine)


@pytest.mark.parametrize("angle", [0.0, 45.0])
def test_share_of_beams_that_pass_follows_the_length_of_their_way(angle):
    scene, canopy = level()
    rays, start, ground = beams(angle)
    found = echoes(Landscape(scene, canopy, Cover((layer(),))), rays, start, ground, 5, np.random.default_rng(1))
    struck = np.unique(found.ray[found.source == TURF])
    passed = math.exp(-DEPTH / math.cos(math.radians(angle)))
    assert 1 - len(struck) / len(rays) == pytest.approx(passed, abs=0.012)
    above = 20.0 - found.distance * math.cos(math.radians(angle))
    assert above.min() >= -1e-9
    assert above.max() <= HEIGHT + 0.08, "half a step of the way at most"
    assert above[found.source == GROUND] == pytest.approx(0.0, abs=1e-9)


def test_first_echoes_thin_out_downwards_as_the_law_says():
    scene, canopy = level()
    rays, start, ground = beams(0.0)
    found = echoes(Landscape(scene, canopy, Cover((layer(),))), rays, start, ground, 1, np.random.default_rng(2))
    above = 20.0 - found.distance
    for part in (0.25, 0.5, 0.75):
        expected = 1 - math.exp(-DEPTH * (1 - part))
        assert (above > part * HEIGHT).mean() == pytest.approx(expected, abs=0.02)


def test_echoes_are_in_order_and_apart_and_few():
    scene, canopy = level()
    rays, start, ground = beams(20.0, 10_000)
    high = layer(1.9, 4.0, LEAVES)
    found = echoes(
        Landscape(scene, canopy, Cover((layer(), high))), rays, start - 1.0, ground, 3, np.random.default_rng(3)
    )
    same = np.diff(found.ray) == 0
    assert (np.diff(found.ray) >= 0).all()
    assert (np.diff(found.distance)[same] >= SEPARATION - 1e-9).all()
    assert np.bincount(found.ray).max() == 3
    assert np.bincount(found.ray, found.energy).max() <= 1 + 1e-9


def test_what_a_beam_meets_is_in_proportion_to_the_densities():
    scene, canopy = level()
    rays, start, ground = beams(0.0)
    cover = Cover((layer(depth=1.0), layer(depth=3.0, source=LEAVES)))
    found = echoes(Landscape(scene, canopy, cover), rays, start, ground, 1, np.random.default_rng(4))
    plants = found.source[found.source != GROUND]
    assert (plants == LEAVES).mean() == pytest.approx(0.75, abs=0.015)


def test_optical_depth_of_the_whole_way_is_the_layers():
    scene, canopy = level()
    rays, start, ground = beams(30.0, 500)
    crossing = Crossing(
        Landscape(scene, canopy, Cover((layer(), layer(0.4, 0.5)))), rays, start, ground, np.random.default_rng(5)
    )
    assert crossing.optical[-1].mean() == pytest.approx((DEPTH + 0.5) / math.cos(math.radians(30.0)), rel=0.02)
