"""Patches against shapes whose planes and motions are known, and registration where most has moved."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.registration.point_to_plane import Matcher
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.result import RegistrationResult
from slopewatch.engine.registration.surface import Surface
from slopewatch.engine.registration.surface_patches import cut, equations
from slopewatch.interface.parameters import RegistrationParameters
from slopewatch.simulation.surveys.moving_pieces import MovedEpoch, first_epoch, moved_epoch

POINTS = 60_000


@cache
def first() -> np.ndarray:
    return first_epoch(1, POINTS)


def error(found: RegistrationResult, epoch: MovedEpoch) -> float:
    still = epoch.xyz[epoch.stable]
    away = found.transform.apply(still) - epoch.transform.apply(still)
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))


def roof(seed: int, noise: float = 0.003) -> np.ndarray:
    """Two planes of 45 degrees that meet in a ridge along y."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-3, 3, (2, 15_000))
    return np.column_stack([x, y, -np.abs(x) + rng.normal(0, noise, x.size)])


def test_patches_face_one_way_and_cover_the_surface():
    surface = Surface(roof(1), 0.1)
    patches = cut(surface, 0.01)
    sides = np.abs(patches.normal @ np.array([[1, 0, 1], [-1, 0, 1]]).T) / np.sqrt(2)
    assert np.quantile(sides.max(axis=1), 0.1) > 0.99
    assert patches.area.sum() == pytest.approx(36 * np.sqrt(2), rel=0.1)
    assert np.mean(patches.number >= 0) > 0.9
    assert patches.around.sum(axis=1) == pytest.approx(np.ones(len(patches)))


def test_a_motion_leaves_of_each_patch_what_it_moves_along_its_normal():
    surfaces = Surface(roof(1), 0.1), Surface(roof(2), 0.1)
    patches = cut(surfaces[1], 0.01)
    system = equations(Matcher(*surfaces, given_radius=3.0), patches, Pose.identity(), 0.5)
    along_ridge, across = np.zeros(6), np.zeros(6)
    along_ridge[4], across[3] = 0.1, 0.1
    excess = np.sqrt(system.excess(np.stack([along_ridge, across])))
    some = (system.pairs > 60) & (np.abs(patches.centre[:, 0]) > 0.5)
    assert np.count_nonzero(some) > 20
    # a plane of noisy points slides along itself freely: its normals' noise is no relief
    assert np.median(excess[some, 0]) < 0.004
    assert np.median(excess[some, 1]) == pytest.approx(0.1 / np.sqrt(2), rel=0.05)


@pytest.mark.parametrize("share", [0.6, 0.75])
def test_what_stayed_is_found_where_most_has_moved(share):
    epoch = moved_epoch(1, share, points=POINTS)
    found = register(first(), epoch.xyz, RegistrationParameters())
    assert error(found, epoch) < 0.002
    assert found.unobservable == ()
    assert found.registration_error < 0.002
    assert any("taken as stable" in warning for warning in found.warnings)
    # what is called stable is, but for what lies within the noise after its own motion
    assert found.agreement.stable_share == pytest.approx(1 - epoch.share, abs=0.12)


def test_a_block_that_rose_is_refused():
    """Slopes sink: the part that seems to have stayed may have sunk by as much."""
    epoch = moved_epoch(1, 0.55, together=True, points=POINTS)
    with pytest.raises(InputError, match=r"then rose.*--stable"):
        register(first(), epoch.xyz, RegistrationParameters())


def test_two_parts_that_contradict_each_other_are_refused():
    """Half of the pieces went down together by 0.2 m: nothing tells which half stayed."""
    reference, epoch = first_epoch(3, POINTS), moved_epoch(3, 0.0, points=POINTS)
    later = epoch.transform.apply(epoch.xyz)
    east = later[:, 0] > np.median(later[:, 0])
    middle = later[:, 1] > np.median(later[:, 1])
    later = later + np.where((east & middle)[:, None], [0.0, 0.0, 0.2], 0.0)
    later = later + np.where((~east & middle)[:, None], [0.1, 0.0, -0.25], 0.0)
    later = later + np.where((east & ~middle)[:, None], [0.0, 0.15, 0.45], 0.0)
    with pytest.raises(InputError, match=r"clearly the one that did not move.*--stable.*--accept-unstable"):
        register(reference, later, RegistrationParameters())
    accepted = register(reference, later, RegistrationParameters(accept_unstable=True))
    still = later[~east & ~middle]
    away = accepted.transform.apply(still) - still
    assert accepted.registration_error > 0.5 * np.sqrt(np.mean(away[:, 2] ** 2))
    assert accepted.registration_error > 0.05


def test_nearly_everything_moved_is_refused():
    epoch = moved_epoch(1, 0.99, points=POINTS)
    with pytest.raises(InputError, match="--accept-unstable"):
        register(first(), epoch.xyz, RegistrationParameters())


def test_the_same_cloud_twice_stays():
    found = register(first(), first().copy(), RegistrationParameters())
    assert np.abs(found.transform.apply(first()) - first()).max() < 1e-6
    assert found.warnings == ()


def test_half_of_a_slope_that_slid_as_one_is_refused_or_covered():
    """Both halves agree each on its own motion, and neither lies far from where it was surveyed."""
    reference, epoch = first_epoch(3, POINTS), moved_epoch(3, 0.0, points=POINTS)
    later = epoch.transform.apply(epoch.xyz)
    slid = later[:, 0] > np.quantile(later[:, 0], 0.48)
    later = later + np.where(slid[:, None], [0.05, 0.0, -0.2], 0.0)
    with pytest.raises(InputError, match=r"agrees on one motion \(0.*and .*on another \(0.*apart.*--stable"):
        register(reference, later, RegistrationParameters())
    accepted = register(reference, later, RegistrationParameters(accept_unstable=True))
    away = accepted.transform.apply(later[~slid]) - later[~slid]
    assert accepted.registration_error > 0.5 * np.sqrt(np.mean(away[:, 2] ** 2))
    assert accepted.registration_error > 0.1
    assert accepted.covariance is not None
    assert np.sqrt(accepted.covariance[3:, 3:].trace()) > 0.15
    assert any("undecidable which part" in warning for warning in accepted.warnings)
    # the same slide on stable ground that reaches far beyond what surveys err by is told apart
    far = later + np.where(slid[:, None], [0.0, 0.0, -0.6], 0.0)
    told = register(reference, far, RegistrationParameters())
    assert np.abs(told.transform.apply(far[~slid]) - far[~slid]).max() < 0.005
    assert any("lies where it was surveyed" in warning for warning in told.warnings)
