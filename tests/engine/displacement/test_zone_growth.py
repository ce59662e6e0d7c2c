"""Zones of slow slides: found where hardly a window shows them, as large and as long as they are."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.displacement.displacement import Displacement, measure_displacement
from slopewatch.engine.displacement.registered import Registered
from slopewatch.interface.parameters import DisplacementParameters
from slopewatch.tests.builders.rough_ground import axes, in_the_map, relief, sampled

SIDE_M, HALF_M = 22.0, (6.0, 4.0)
MOTION_M = 0.05


def on_the_plane(xyz: np.ndarray) -> np.ndarray:
    return (xyz - in_the_map(np.zeros((1, 3)))) @ axes().T


def inside(xyz: np.ndarray) -> np.ndarray:
    """Which places are in the ellipse."""
    plane = on_the_plane(xyz)
    return np.hypot(*((plane[:, :2] - SIDE_M / 2) / HALF_M).T) < 1


@pytest.fixture(scope="module")
def ground() -> tuple[np.ndarray, np.ndarray]:
    heights = relief(SIDE_M, 0.09, seed=7)
    first, later = (sampled(heights, 50.0, 0.02, seed, gaps=0.25) for seed in (3, 4))
    return first, later + np.where(inside(later)[:, None], MOTION_M * axes()[0], 0.0)


def measured(ground: tuple[np.ndarray, np.ndarray], registered: Registered | None = None) -> Displacement:
    return measure_displacement(*ground, DisplacementParameters(), registered or Registered.unknown())


@pytest.fixture(scope="module")
def slow(ground) -> Displacement:
    return measured(ground)


def test_a_slow_slide_is_a_zone_of_its_own_ground(slow):
    (zone,) = slow.zones
    assert zone.probability < 0.01
    assert inside(slow.vectors.places[zone.windows]).mean() > 0.7
    assert zone.area > 0.75 * np.pi * HALF_M[0] * HALF_M[1] * np.cos(np.radians(35.0))


def test_its_motion_is_within_its_errors_and_small(slow):
    (zone,) = slow.zones
    off = zone.in_plane[:2] - [MOTION_M, 0.0]
    assert off @ np.linalg.solve(zone.in_plane_covariance[:2, :2], off) < 9.2
    assert np.sqrt(zone.in_plane_covariance[0, 0]) < 0.35 * MOTION_M


def test_few_of_its_windows_show_it_by_themselves(slow):
    (zone,) = slow.zones
    assert np.mean([v.significant(0.99)[zone.windows].mean() for v in slow.by_width]) < 0.5


def test_a_doubtful_registration_leaves_no_zone(ground):
    assert measured(ground, Registered.shift(0.05, 0.02)).zones == ()
