"""Errors of motion against ground that rests, where a registration turned a survey: drawn turns, and a known one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slopewatch.engine.displacement.displacement import Displacement, measure_displacement
from slopewatch.engine.displacement.reference import Reference
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.displacement.vectors import common_motion, squared_length
from slopewatch.interface.parameters import DisplacementParameters
from slopewatch.tests.builders.rough_ground import axes, in_the_map, relief, sampled

SIDE_M, STABLE_M = 18.0, 6.0
DRAWS, SMALL = 1500, 0.02  # turns are drawn so much smaller, within what the robust mean takes as one motion
TURN = np.array([0.002, 0.003, 0.006])
SHIFT_M = np.array([0.03, 0.02, 0.01])


def on_plane(places: np.ndarray) -> np.ndarray:
    return (places - in_the_map(np.zeros((1, 3)))) @ axes().T


def rests(xy: np.ndarray) -> np.ndarray:
    """The lowest third across the dip, which is level, so that its bounds are those in the map."""
    across = (np.column_stack([xy, np.zeros(len(xy))]) - in_the_map(np.zeros((1, 3))) * [1, 1, 0]) @ axes()[1]
    return across < STABLE_M


@pytest.fixture(scope="module")
def ground() -> tuple[np.ndarray, np.ndarray]:
    heights = relief(SIDE_M, 0.15, seed=5)
    return tuple(sampled(heights, 80.0, 0.02, seed, gaps=0.3) for seed in (1, 2))


@pytest.fixture(scope="module")
def stated(ground) -> Registered:
    """A registration that turns about a place outside the ground."""
    return Registered(np.diag([*TURN**2, *SHIFT_M**2]), ground[0].mean(axis=0) + [30.0, -20.0, 5.0], known=True)


def measured(ground, registered: Registered, stable=rests, **given) -> Displacement:
    return measure_displacement(*ground, DisplacementParameters(**given), registered, stable)


@pytest.fixture(scope="module")
def found(ground, stated) -> Displacement:
    return measured(ground, stated)


def test_what_is_left_of_drawn_turns_scatters_as_stated(found, stated):
    wide = found.by_width[-1]
    exact = replace(wide, covariance=wide.covariance - found.reference.at(wide.places))
    places, among = exact.places, rests(exact.places[:, :2])
    assert 5 < (exact.measured & among).sum() < 0.6 * exact.measured.sum()
    rng = np.random.default_rng(4)
    left = np.empty((DRAWS, len(places), 3))
    for k in range(DRAWS):
        turn, shift = rng.normal(0.0, SMALL * TURN), rng.normal(0.0, SMALL * SHIFT_M)
        feigned = Rotation.from_rotvec(turn).apply(places - stated.centre) + stated.centre + shift - places
        still = replace(exact, motion=np.where(exact.measured[:, None], feigned, np.nan))
        left[k] = (feigned - common_motion(still, 1.0, among).motion) / SMALL
    scatter = np.einsum("kni,knj->nij", left, left) / DRAWS
    rested = replace(exact, motion=0.0 * exact.motion)
    reference = Reference.of(stated, common_motion(rested, 1.0, among))
    expected = reference.at(places) - reference.covariance
    inner, outer = (exact.axes @ one @ np.swapaxes(exact.axes, 1, 2) for one in (scatter, expected))
    along = np.sqrt(np.trace(inner[:, :2, :2], axis1=1, axis2=2)), np.sqrt(np.trace(outer[:, :2, :2], axis1=1, axis2=2))
    far = ~among
    assert along[1][far].max() > 0.05
    assert np.abs(along[0] / along[1] - 1)[far].max() < 0.08
    assert np.sqrt(inner[far, 2, 2]) == pytest.approx(np.sqrt(outer[far, 2, 2]), abs=0.002)


def test_the_vectors_hold_what_the_turn_adds_and_no_more(found, ground, stated):
    shift_alone = measured(ground, Registered(np.diag([0, 0, 0, *SHIFT_M**2]), stated.centre, known=True))
    unknown = measured(ground, Registered.unknown())
    assert np.array_equal(shift_alone.by_width[-1].covariance, unknown.by_width[-1].covariance, equal_nan=True)
    more = (found.by_width[-1].covariance - unknown.by_width[-1].covariance)[found.by_width[-1].measured]
    arm = (found.vectors.places - found.stable.centre)[found.by_width[-1].measured]
    across = np.array([np.cross(np.diag(TURN), one) for one in arm])  # of each turn, row by row
    across -= np.diag(TURN) @ found.stable.by_turn.T
    assert np.allclose(more, np.swapaxes(across, 1, 2) @ across, atol=1e-12)


def test_a_known_turn_is_no_motion_beyond_its_error(ground):
    """Turned by 8 mrad about the normal of the slope: 8 cm at 10 m from the ground that rests."""
    first, later = ground
    turn, centre = 0.008 * axes()[2], first.mean(axis=0)
    turned = Rotation.from_rotvec(turn).apply(later - centre) + centre
    known = Registered(np.diag([*np.full(3, 0.008**2), *SHIFT_M**2]), centre, known=True)
    for more in ({}, {"subtract": True}):
        stable = None if more else rests
        held, alone = (measured((first, turned), one, stable, **more) for one in (known, Registered.unknown()))
        arm = held.vectors.places - held.reference.registered.centre
        far = held.vectors.measured & (np.linalg.norm(arm, axis=1) > 6)
        assert alone.significant[far].mean() > 0.3
        assert held.significant[far].mean() < 0.05
        assert held.zones == ()
        off = held.by_width[-1].motion - np.cross(turn, arm) + (held.stable or held.common).by_turn @ turn
        assert np.nanmedian(squared_length(off[far], alone.by_width[-1].covariance[far])) < 6
