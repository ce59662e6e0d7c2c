"""Surveys a few days apart: one for velocities and alerts."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from slopewatch.engine.series import analysis
from slopewatch.engine.series import level_history as levels
from slopewatch.engine.series.alerts import read_alerts
from slopewatch.engine.series.level_history import Displacements, level_history
from slopewatch.engine.series.velocity import zone_velocity
from slopewatch.engine.series.visits import visits

SIGMA_M = 0.005


def history(days, change):
    n = len(days)
    zone = Displacements(
        np.array(days, dtype=float), np.array(change), np.full(n, SIGMA_M**2), np.array([False] + [True] * (n - 1)),
        np.full(n, 10.0),
    )  # fmt: skip
    return level_history(zone, read_alerts(None))


def test_a_bad_survey_the_next_day_raises_no_alert(monkeypatch):
    days, change = [0, 30, 60, 90, 91], [0.0, -0.03, -0.06, -0.09, -0.125]  # 1 mm a day, then 3.4 cm off
    found = history(days, change)
    assert max(found.levels) == found.levels[-2]
    monkeypatch.setattr(levels, "visits", lambda *arrays: arrays)
    assert history(days, change).levels[-1] >= 3  # 35 mm a day, taken as it is


def test_a_quiet_day_withdraws_nothing():
    found = history([0, 30, 60, 90, 91, 92], [0.0, -0.1, -0.2, -0.3, -0.3, -0.3])
    assert found.levels[3] >= 2
    assert found.levels[3:] == (found.levels[3],) * 3


def test_weeks_apart_stay_as_they_are():
    arrays = np.array([0.0, 7.0, 14.0, 28.0]), np.array([0.0, 0.1, np.nan, 0.3]), np.full(4, 1e-4)
    for given, found in zip(arrays, visits(*arrays), strict=True):
        np.testing.assert_array_equal(given, found)


def test_a_visit_is_the_weighted_mean_widened_by_its_misfit():
    days, change, variance = visits(
        np.array([0.0, 40.0, 42.0, 90.0]), np.array([0.0, 0.10, 0.13, 0.2]), np.array([1e-4, 1e-4, 4e-4, 1e-4])
    )
    assert np.isnan(change[1])
    assert days[2] == pytest.approx((40 * 4 + 42) / 5)
    assert change[2] == pytest.approx((0.10 * 4 + 0.13) / 5)
    # chi-square 1.8 of one degree of freedom
    assert variance[2] == pytest.approx(1.8 / (1e4 + 2.5e3))


def test_intervals_hold_the_true_velocity_with_daily_surveys():
    rng = np.random.default_rng(1)
    days = np.array([0.0, 30, 31, 60, 61, 62, 90])
    held = []
    for _ in range(200):
        change = -0.001 * days + rng.normal(0, SIGMA_M, len(days))
        found = zone_velocity(*visits(days, change - change[0], np.full(len(days), SIGMA_M**2)))
        held.append(found.low <= -0.001 <= found.high)
    assert np.mean(held) >= 0.93


def test_the_limits_of_a_fast_series_are_plain_numbers(monkeypatch):
    # 0.9 and 4 mm a day are 27.4 and 121.75 mm a month of 30.4375 days
    monkeypatch.setattr(analysis, "detectable_rates", lambda *_: ([9, 30], [0.9, 4.0]))
    seen, _ = analysis.limits_of(SimpleNamespace(incremental=[]), ())
    assert "9 to 30 days apart, a cell must move by 27 to 122 mm/month to be seen" in seen
