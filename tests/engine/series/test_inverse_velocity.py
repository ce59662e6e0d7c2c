"""Failure times: the interval holds the true one, and none is told where the conditions do not hold."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.series.inverse_velocity import failure_time

DAYS = np.array([0.0, 30.0, 55.0, 75.0, 90.0, 100.0])
FAILURE, SIGMA = 110.0, 0.005


def fukuzono(days: np.ndarray, scale: float = 0.12, failure: float = FAILURE) -> np.ndarray:
    """1/v = (failure - t) / scale."""
    return -scale * np.log((failure - days) / failure)


def noisy(motion: np.ndarray, rng: np.random.Generator, sigma: float = SIGMA) -> np.ndarray:
    y = motion + rng.normal(0, sigma, len(motion))
    return y - y[0]


def test_motion_has_the_velocity_of_the_law():
    t = np.linspace(0, 100, 10001)
    v = np.gradient(fukuzono(t), t)[1:-1]
    np.testing.assert_allclose(1 / v, (FAILURE - t[1:-1]) / 0.12, rtol=1e-3)


def test_interval_holds_the_failure_in_most_seeds():
    rng = np.random.default_rng(0)
    told = [failure_time(DAYS, noisy(fukuzono(DAYS), rng), np.full(6, SIGMA**2)) for _ in range(200)]
    told = [f for f in told if f.earliest is not None]
    assert len(told) > 120
    assert np.mean([f.earliest <= FAILURE <= f.latest for f in told]) >= 0.9
    assert all(f.earliest >= DAYS[-1] and f.latest > f.earliest and not f.reason for f in told)


@pytest.mark.parametrize(
    "motion",
    [
        0.3 * (1 - np.exp(-DAYS / 40)),  # decelerating
        0.003 * DAYS,  # steady
        0 * DAYS,  # noise alone
        0.02 * np.array([0, 1, 2, 4, 4.1, 4.2]),  # came to rest
        -0.2 * np.sqrt(DAYS / 100),
    ],
)
def test_no_failure_time_without_acceleration(motion):
    rng = np.random.default_rng(1)
    for sigma in (SIGMA, 0.03):
        for _ in range(150):
            found = failure_time(DAYS, noisy(motion, rng, sigma), np.full(6, sigma**2))
            # a steady motion may look faster and faster by chance, at the level of the interval
            if not np.array_equal(motion, 0.003 * DAYS):
                assert found.earliest is None
                assert found.reason.startswith("not computable: ")
                assert found.latest is None


def test_steady_motion_seldom_looks_like_one_that_ends():
    rng = np.random.default_rng(2)
    found = [failure_time(DAYS, noisy(0.003 * DAYS, rng), np.full(6, SIGMA**2)) for _ in range(500)]
    assert sum(f.earliest is not None for f in found) <= 10


def test_the_interval_holds_for_other_exponents_too():
    rng, held = np.random.default_rng(3), []
    for _ in range(150):
        power = 1 / (rng.uniform(1.7, 2.2) - 1)
        fine = np.linspace(0, DAYS[-1], 4000)
        speed = 0.005 * ((FAILURE - fine) / 30) ** -power
        way = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(fine))])
        y = noisy(np.interp(DAYS, fine, way), rng)
        wide, fixed = (failure_time(DAYS, y, np.full(6, SIGMA**2), e) for e in ((1.5, 2.5), (2.0, 2.0)))
        held.append([f.earliest is not None and f.earliest <= FAILURE <= f.latest for f in (wide, fixed)])
    wide, fixed = np.mean(held, axis=0)
    assert wide >= 0.85
    assert fixed <= wide - 0.2  # alpha = 2 alone states too much


def test_the_reason_is_reported():
    tight = np.full(6, 0.001**2)

    def reason(motion, days=DAYS, variance=tight):
        return failure_time(days, motion, variance).reason

    assert "4 surveys, at least 5" in reason(fukuzono(DAYS)[:4], DAYS[:4], tight[:4])
    assert "does not get faster" in reason(0.3 * (1 - np.exp(-DAYS / 40)))
    assert "level of detection" in reason(0 * DAYS)
    assert "step-like" in reason(np.array([0, 0.1, 0.15, 0.16, 0.17, 0.20]))
    assert "a steady motion explains" in reason(0.003 * np.maximum(DAYS - 40, 0) + 1e-4 * (DAYS == 100))
    assert "no law of failure" in reason(np.array([0, 0.03, 0.056, 0.0775, 0.094, 0.80]))


def test_surveys_without_measurement_do_not_count():
    motion = fukuzono(DAYS)
    motion[[1, 2, 3]] = np.nan
    assert "3 surveys" in failure_time(DAYS, motion, np.full(6, 1e-6)).reason


def test_lowering_is_as_good_as_raising():
    up, down = (failure_time(DAYS, s * fukuzono(DAYS), np.full(6, SIGMA**2)) for s in (1, -1))
    assert (up.earliest, up.latest) == pytest.approx((down.earliest, down.latest))
