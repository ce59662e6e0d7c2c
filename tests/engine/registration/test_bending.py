"""Surveys that are bent by a known amount, beside real change that no correction may take away."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation
from slopewatch.engine.geometry.rigid_transform import BentTransform, RigidTransform
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.result import RegistrationResult
from slopewatch.interface.parameters import RegistrationParameters

ORIGIN = np.array([500_000.0, 3_500_000.0, 100.0])
WIDTH, DEPTH, TILT = 60.0, 24.0, 0.7
RNG = np.random.default_rng(0)
RELIEF = sum(
    weight * sigma * gaussian_filter(RNG.normal(size=(140, 320)), sigma)
    for sigma, weight in ((1, 0.06), (4, 0.10), (12, 0.3))
)


def scan(seed: int, n: int = 40_000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, WIDTH, n), rng.uniform(0, DEPTH, n)
    z = TILT * y + map_coordinates(RELIEF, [y * 5, x * 5], order=1) + rng.normal(0, 0.015, n)
    return ORIGIN + np.column_stack([x, y, z])


def case(bend: float, change: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Reference, later epoch as surveyed, the later epoch's true points, and which of them are on a changed disc.

    ``bend`` (m) is the height of a bowl's rims over its middle, ``change`` (m) what a disc of radius 4 m rose by.
    """
    after = scan(2)
    x, y = (after - ORIGIN).T[:2]
    disc = np.hypot(x - 18, y - 12) < 4
    after[:, 2] += np.where(disc, change, 0.0)
    bowl = np.zeros_like(after)
    bowl[:, 2] = bend * ((x - WIDTH / 2) / (WIDTH / 2)) ** 2
    truth = RigidTransform(
        Rotation.from_rotvec([1e-4, -2e-4, 1e-4]).as_matrix(), np.array([0.05, -0.04, 0.03]), after.mean(axis=0)
    )
    return scan(1), truth.inverse().apply(after + bowl), after, disc


def height_errors(result: RegistrationResult, moving: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Error of the surface's height at each point after registration, metres."""
    away = result.transform.apply(moving) - after
    return away @ np.array([0.0, -TILT, 1.0])


@pytest.fixture(scope="module")
def bowl():
    return case(0.06, -0.30)


@pytest.fixture(scope="module")
def rigid(bowl) -> RegistrationResult:
    return register(*bowl[:2], RegistrationParameters(piecewise="never"))


@pytest.fixture(scope="module")
def bent(bowl) -> RegistrationResult:
    return register(*bowl[:2], RegistrationParameters(piecewise="auto"))


def test_a_bowl_is_taken_off_where_asked_for_and_change_stays(bowl, rigid, bent):
    _, moving, after, disc = bowl
    before, now = (height_errors(result, moving, after) for result in (rigid, bent))
    assert np.sqrt(np.mean(before[~disc] ** 2)) > 0.010
    assert np.sqrt(np.mean(now[~disc] ** 2)) < 0.003
    # of the disc's change next to nothing was taken off with the bowl
    assert abs(np.mean(now[disc])) < 0.004
    assert isinstance(bent.transform, BentTransform)
    assert bent.summary()["pieces"]["spacing"] == 20.0


def test_a_bend_is_told_and_widens_the_level_where_it_stays(bowl, rigid, bent):
    _, moving, after, disc = bowl
    assert not isinstance(rigid.transform, BentTransform)
    assert any("--piecewise auto" in warning for warning in rigid.warnings)
    made = np.sqrt(np.mean(height_errors(rigid, moving, after)[~disc] ** 2))
    assert 0.5 < rigid.registration_error / made < 2.0
    assert bent.registration_error < 0.4 * rigid.registration_error
    assert any("corrected" in warning for warning in bent.warnings)


@pytest.mark.parametrize("change", [-0.30, -0.04])
def test_change_alone_is_no_bend(change):
    reference, moving, *_ = case(0.0, change)
    result = register(reference, moving, RegistrationParameters(piecewise="auto"))
    assert not isinstance(result.transform, BentTransform)
    assert not result.warnings
