"""Velocities against numpy's own regression, and their intervals against known motions with known noise."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.series.velocity import cell_velocity, fit_line, own_variances, zone_velocity

DAYS = np.array([0.0, 30.0, 62.0, 91.0, 122.0, 150.0])


def test_line_is_numpys_weighted_one_and_its_error_the_textbooks():
    rng = np.random.default_rng(0)
    y, sigma = rng.normal(0, 1, 6), rng.uniform(0.5, 2, 6)
    line = fit_line(DAYS, y, sigma**2)
    (slope, _), covariance = np.polyfit(DAYS, y, 1, w=1 / sigma, cov="unscaled")
    assert (line.slope, line.error) == pytest.approx((slope, covariance[0, 0] ** 0.5))
    even = fit_line(DAYS, y, np.full(6, 0.04))
    assert even.error == pytest.approx(0.2 / np.sqrt(np.sum((DAYS - DAYS.mean()) ** 2)))


def test_cells_get_the_line_of_the_surveys_that_measured_them():
    rng = np.random.default_rng(1)
    change = [rng.normal(0, 0.05, (4, 5)) + 0.002 * day for day in DAYS]
    variance = [rng.uniform(1e-4, 4e-4, (4, 5)) for _ in DAYS]
    change[2][1, 1] = np.nan
    for dz in change[1:]:
        dz[3, 3] = np.nan
    found = cell_velocity(DAYS, change, variance)
    for row, column in ((0, 0), (1, 1), (2, 4)):
        y, v = (np.array([a[row, column] for a in s]) for s in (change, variance))
        known = np.isfinite(y)
        line = fit_line(DAYS[known], y[known], v[known])
        widened = max(1.0, line.misfit / (known.sum() - 2)) ** 0.5
        assert found.rate[row, column] == pytest.approx(line.slope)
        assert found.error[row, column] == pytest.approx(line.error * widened)
        assert found.count[row, column] == known.sum()
    assert np.isnan(found.rate[3, 3])
    assert np.isnan(found.error[3, 3])


def creep(rate: float, onset: float) -> np.ndarray:
    return rate * np.maximum(DAYS - onset, 0.0)


@pytest.mark.parametrize(("rate", "onset"), [(0.002, 0.0), (0.005, 45.0), (-0.01, 75.0), (0.0, 0.0)])
def test_interval_holds_the_true_velocity(rate, onset):
    rng = np.random.default_rng(2)
    sigma, held, onsets = 0.012, 0, 0
    for _ in range(400):
        y = creep(rate, onset) + rng.normal(0, sigma, 6)
        found = zone_velocity(DAYS, y - y[0], np.full(6, sigma**2))
        held += found.low <= rate <= found.high
        onsets += found.onset is not None
    assert held / 400 >= 0.93
    if onset == 0:
        assert onsets / 400 < 0.06  # a straight motion is refused by chance only
    if abs(rate) >= 0.005 and onset:
        assert onsets / 400 > 0.9


def test_onset_lies_between_the_surveys_around_it():
    found = zone_velocity(DAYS, creep(0.01, 75.0), np.full(6, 0.01**2))
    assert found.onset == (2, 3)
    assert found.epochs == (3, 4, 5)
    assert found.rate == pytest.approx(0.01, rel=0.002)


def test_trend_is_named():
    tight = np.full(6, 0.002**2)
    assert zone_velocity(DAYS, 0.001 * DAYS, tight).trend == "steady"
    assert zone_velocity(DAYS, -1e-5 * DAYS**2, tight).trend == "accelerating"
    assert zone_velocity(DAYS, 0.1 * (1 - np.exp(-DAYS / 50)), tight).trend == "decelerating"
    assert zone_velocity(DAYS, np.array([0, 0.1, -0.1, 0.1, -0.1, 0.1]), tight).trend == "irregular"
    assert zone_velocity(DAYS[:3], 0.001 * DAYS[:3], tight[:3]).trend == "not known"


def test_surveys_that_did_not_measure_are_left_out():
    y = np.array([0.0, np.nan, 0.062, 0.091, np.nan, 0.15])
    found = zone_velocity(DAYS, y, np.full(6, 1e-4))
    assert found.epochs == (0, 2, 3, 5)
    assert found.rate == pytest.approx(0.001, rel=0.03)
    assert zone_velocity(DAYS, np.array([0.0, *[np.nan] * 5]), np.full(6, 1e-4)) is None


def test_scatter_beyond_the_errors_widens_the_interval():
    rough = 0.001 * DAYS + np.array([0.02, -0.02, 0.02, -0.02, 0.02, -0.02])
    rest = rough - np.polyval(np.polyfit(DAYS, rough, 1), DAYS)
    s = np.sqrt(np.sum(rest**2) / 4)
    textbook = s / np.sqrt(np.sum((DAYS - DAYS.mean()) ** 2))
    cells = cell_velocity(DAYS, [np.full((1, 1), y) for y in rough], [np.full((1, 1), 0.005**2)] * 6)
    assert cells.error[0, 0] == pytest.approx(textbook)
    # the unknown onset adds to that
    assert textbook < zone_velocity(DAYS, rough, np.full(6, 0.005**2)).error < 3 * textbook


def test_own_variances_add_up_to_those_of_the_differences():
    first, other = np.full((2, 2), 4e-4), [np.full((2, 2), 1e-4), np.full((2, 2), 9e-4)]
    shared = [0.01, 0.02]
    errors = [np.sqrt(first + v + s**2) for v, s in zip(other, shared, strict=True)]
    own = own_variances(errors, shared, first, other)
    np.testing.assert_allclose(own[0], first)
    for got, v, s in zip(own[1:], other, shared, strict=True):
        np.testing.assert_allclose(got, v + s**2)
