"""Series of one zone from drawn changes whose means and errors are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.series.alerts import read_alerts
from slopewatch.engine.series.tracking import Sighting, Track
from slopewatch.engine.series.zone_series import Stack, zone_series

SHAPE, DAYS = (40, 50), np.array([0.0, 30.0, 60.0, 90.0])
SIGMA, REGISTRATION = 0.02, 0.004


def stack(rate: float = -0.002, seed: int = 0, shared: float = REGISTRATION) -> tuple[Stack, Track]:
    rng = np.random.default_rng(seed)
    inside = np.zeros(SHAPE, dtype=bool)
    inside[10:20, 10:22] = True
    first = rng.normal(0, SIGMA, SHAPE)
    change = [np.zeros(SHAPE)]
    for day in DAYS[1:]:
        change.append(rng.normal(0, SIGMA, SHAPE) - first + rate * day * inside + rng.normal(0, shared))
    significant = [np.abs(c) > 1.96 * 2**0.5 * SIGMA for c in change]
    cells = np.flatnonzero(inside)
    track = Track("S001", int(np.sign(rate)), (Sighting(1, cells, "new"),), cells, "", "")
    return Stack(DAYS, change, [np.full(SHAPE, SIGMA**2)] * 4, [0.0, *[shared] * 3], significant, 0.5), track


def series(given: Stack, track: Track):
    return zone_series([track], given, read_alerts(None), minimum_area=1.0, bridged=2)[0]


def test_means_and_errors_are_those_of_the_cells():
    given, track = stack()
    found = series(given, track)
    for i in range(1, 4):
        assert found.change[i] == pytest.approx(given.change[i].ravel()[track.footprint].mean())
        assert found.variance[i] >= SIGMA**2 / 120 + REGISTRATION**2 - 1e-12
    assert found.change[0] == found.error[0] == 0
    assert found.variance[0] == pytest.approx(SIGMA**2 / 120)
    assert found.measured.tolist() == [120] * 4


def test_errors_hold_the_truth_as_often_as_they_say():
    ratios, rates = [], 0
    for seed in range(100):
        found = series(*stack(seed=seed))
        ratios.append((found.change[1:] + 0.002 * DAYS[1:]) / found.error[1:])
        rates += found.velocity.low <= -0.002 <= found.velocity.high
    assert np.mean(np.abs(ratios) <= 1.96) >= 0.93
    assert 0.6 <= np.std(ratios) <= 1.1  # nor much larger than they need to be
    assert rates >= 92


def test_a_survey_that_measured_little_of_it_does_not_count_and_half_of_it_is_less_sure():
    given, track = stack()
    change = [c.copy() for c in given.change]
    change[2].ravel()[track.footprint[:115]] = np.nan
    change[3].ravel()[track.footprint[:60]] = np.nan
    found, whole = series(replace(given, change=change), track), series(given, track)
    assert found.measured.tolist() == [120, 120, 0, 60]
    assert np.isnan(found.change[2])
    assert found.variance[3] > whole.variance[3]


def test_confirmed_needs_the_sign_the_level_and_the_area():
    given, track = stack()
    assert series(given, track).confirmed.tolist() == [False, True, True, True]
    assert series(given, replace(track, sign=1)).epochs_confirmed == 0
    little = [np.zeros(SHAPE, dtype=bool)] * 4
    assert series(replace(given, significant=little), track).epochs_confirmed == 0
    wide = replace(given, shared=[0.0, *[0.2] * 3])
    assert series(wide, track).epochs_confirmed == 0


def test_holes_and_small_gaps_of_the_footprint_are_filled():
    given, track = stack()
    kept = np.setdiff1d(track.footprint, track.footprint[[40, 41, 66]])
    assert np.array_equal(np.sort(series(given, replace(track, footprint=kept)).cells), track.footprint)
