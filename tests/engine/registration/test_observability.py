"""Stated covariances against the errors made, and surfaces that leave known motions free."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slopewatch.engine.registration.observability import Information, height_sd, information, relief_sd, unknown_motion
from slopewatch.engine.registration.register import register
from slopewatch.interface.parameters import RegistrationParameters

SIDE = 12.0


def points(seed: int, relief, n: int = 20_000, noise: float = 0.01) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-SIDE / 2, SIDE / 2, (2, n))
    return np.column_stack([x, y, relief(x, y) + rng.normal(0, noise, n)])


def rough(x, y):
    waves = ((1.1, 0.7, 0.06), (-0.6, 1.9, 0.05), (3.1, -2.3, 0.03), (0.4, 3.7, 0.03), (-4.2, 1.2, 0.02))
    return 0.7 * y + sum(height * np.sin(a * x + b * y + 5 * height) for a, b, height in waves)


def test_the_covariance_is_that_of_the_errors_made():
    """The squared error in units of the stated covariance has six degrees of freedom."""
    squares = []
    for seed in range(12):
        result = register(points(2 * seed, rough), points(2 * seed + 1, rough), RegistrationParameters())
        found = result.transform
        assert result.covariance is not None
        assert not result.unobservable
        turn = Rotation.from_matrix(found.rotation).as_rotvec()
        wrong = np.concatenate([turn, found.translation])
        squares.append(float(wrong @ np.linalg.solve(result.covariance, wrong)))
    # 12 seeds: 95 % of such means lie between 4.2 and 8.1; the planes' own bias may add a little
    assert 3.0 < np.mean(squares) < 11.0


@pytest.mark.parametrize(
    ("relief", "free"),
    [
        (
            lambda x, y: 0.7 * y,
            {"sliding along the strike", "sliding up and down the slope", "turning about the surface's normal"},
        ),
        (lambda x, y: 0.0 * x, {"sliding to the east", "sliding to the north", "turning about the surface's normal"}),
        (lambda x, y: 0.7 * y + 0.2 * np.sin(2 * x), {"sliding up and down the slope"}),
        (lambda x, y: 0.7 * y + 0.2 * np.sin(2 * y), {"sliding along the strike"}),
        (rough, set()),
    ],
)
def test_free_motions_are_named(relief, free):
    result = register(points(1, relief), points(2, relief) + [0.02, -0.01, 0.03], RegistrationParameters())
    assert set(result.unobservable) == free
    assert bool(free) == any("does not fix" in warning for warning in result.warnings)


def test_what_nothing_fixes_stays_as_surveyed_and_costs_no_height():
    def plane(x, y):
        return 0.7 * y

    shift = np.array([0.10, 0.05, 0.02])
    result = register(points(1, plane), points(2, plane) + shift, RegistrationParameters())
    normal = np.array([0.0, -0.7, 1.0]) / np.hypot(0.7, 1.0)
    assert result.transform.translation @ normal == pytest.approx(-shift @ normal, abs=1e-3)
    along = result.transform.translation - (result.transform.translation @ normal) * normal
    assert np.linalg.norm(along) < 1e-3
    # a slope that slides along itself keeps its heights, however far it may have slid
    assert result.registration_error < 0.005
    assert result.covariance is not None
    assert np.sqrt(result.covariance[3, 3]) > 0.3


def test_height_error_of_a_known_covariance():
    rng = np.random.default_rng(0)
    places = rng.uniform(-10, 10, (4000, 3))
    normals = np.broadcast_to(np.array([0.0, -0.6, 0.8]), places.shape)
    covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 1e-6
    radius = 10.0
    motions = rng.multivariate_normal(np.zeros(6), covariance, 2000)
    heights = []
    for motion in motions:
        moved = np.cross(motion[:3] / radius, places) + motion[3:]
        heights.append(np.mean((np.einsum("ij,ij->i", moved, normals) / 0.8) ** 2))
    assert height_sd(covariance, places, normals, radius) == pytest.approx(np.sqrt(np.mean(heights)), rel=0.05)


def test_without_pairs_there_is_no_step():
    known = Information(np.ones(6), np.eye(6), np.ones(6, dtype=bool), np.eye(6))
    assert (known.damped_step(np.zeros(6), np.zeros((6, 6))) == 0).all()


def test_a_free_motion_of_turn_and_slide_does_not_turn_the_survey():
    """The surveys differ by a slide of 17 cm; of turn and slide together only one combination is fixed."""
    directions = np.eye(6)
    directions[[2, 2, 4, 4], [2, 4, 2, 4]] = [0.8, -0.6, 0.6, 0.8]
    observable = np.array([True, True, False, True, True, True])
    found = Information(np.ones(6), directions, observable, np.eye(6))
    slide = np.array([0.0, 0.0, 0.0, 0.02, 0.17, 0.01])
    held = found.held(slide)
    fixed = directions[:, observable]
    assert fixed.T @ held == pytest.approx(fixed.T @ slide, abs=1e-12), "what is fixed stays"
    assert abs(held[2]) < 0.003, "without regard to what surveys do it would turn by 8 cm at the radius"
    assert held[4] == pytest.approx(0.17, abs=0.005)


def test_a_slide_that_nothing_fixes_is_taken_out_whole():
    observable = np.array([True, True, True, False, True, True])
    found = Information(np.ones(6), np.eye(6), observable, np.eye(6))
    motion = np.array([0.01, -0.02, 0.03, 0.4, 0.05, -0.06])
    assert found.held(motion) == pytest.approx(np.where(observable, motion, 0.0))
    assert np.array_equal(Information(np.ones(6), np.eye(6), np.ones(6, bool), np.eye(6)).held(motion), motion)


def test_what_is_known_of_a_motion_before_is_how_far_it_takes_points():
    """Uniform up to 1.2 m: a variance of 1.2² / 3; a turn may move the typical point as far."""
    assert np.diag(unknown_motion(1.2)) == pytest.approx([0.48] * 6)


@pytest.mark.parametrize("gradient", [0.02, 9.0])
def test_a_free_motion_is_no_farther_than_the_residuals_say(gradient):
    """The curvature of the first motion is 0.01 +- 0.016; ten pairs in two blocks hold its gradient."""
    folds = np.tile(np.diag([0.0, 1.0, 1.0, 1.0, 1.0, 1.0]) / 16.0, (16, 1, 1))
    folds[:, 5, 5] = (0.01 + 0.25 * np.tile([-1.0, 1.0], 8)) / 16.0
    folds[:, 0, 0] = 1.0 / 16.0
    terms, blocks = np.zeros((10, 6)), np.repeat([0, 1], 5)
    terms[[0, 5], 5] = gradient / 2 - 0.05, gradient / 2 + 0.05
    found = information(folds, terms, blocks, 1.0, unknown_motion(np.sqrt(3.0)))
    assert list(found.observable) == [False] + [True] * 5
    scatter = np.hypot(gradient / 2 - 0.05, gradient / 2 + 0.05)
    assert relief_sd(found) == pytest.approx(np.sqrt(0.01) * min(np.hypot(gradient, scatter) / 0.1, 1.0))


def folds_of_curvature(last: float, error: float) -> np.ndarray:
    """Folds of unit curvatures but for the ``last`` one, whose standard error is ``error``."""
    folds = np.tile(np.eye(6) / 16.0, (16, 1, 1))
    folds[:, 5, 5] = (last + error * np.sqrt(15.0) * np.tile([-1.0, 1.0], 8)) / 16.0
    return folds


@pytest.mark.parametrize(("gradient", "fixed"), [(0.001, True), (0.004, False)])
def test_a_curvature_by_relief_in_few_places_fixes_a_direction(gradient, fixed):
    """It stands 3.9 errors above zero. Noise alone, of points 0.2 m apart, would make a gradient of 0.0015."""
    terms = np.zeros((1000, 6))
    terms[:, 5] = np.tile([1.0, -1.0], 500) * gradient * np.sqrt(1000)
    known = information(folds_of_curvature(0.1, 0.0256), terms, np.arange(1000), 0.1, unknown_motion(1.0))
    assert bool(known.observable.all()) is fixed
    sure = information(folds_of_curvature(0.1, 0.01), terms, np.arange(1000), 0.1, unknown_motion(1.0))
    if fixed:  # of an uncertain curvature the error is larger
        weak = [np.sqrt(one.covariance[5, 5]) for one in (known, sure)]
        assert weak[1] == pytest.approx(0.01, rel=0.02)
        assert weak[0] == pytest.approx(0.01 * 3 / (0.1 / 0.0256 - 2), rel=0.02)


def test_relief_that_is_all_in_few_places_fixes_nothing():
    """Even the strongest motion stands but four errors above zero."""
    folds = folds_of_curvature(0.1, 0.0256)
    folds[:, 4, 4] = (2.0 + 0.5 * np.sqrt(15.0) * np.tile([-1.0, 1.0], 8)) / 16.0
    terms = np.zeros((1000, 6))
    terms[:, 5] = np.tile([1.0, -1.0], 500) * 0.001 * np.sqrt(1000)
    known = information(folds, terms, np.arange(1000), 0.1, unknown_motion(1.0))
    assert not known.observable[np.argmin(known.curvature)]
