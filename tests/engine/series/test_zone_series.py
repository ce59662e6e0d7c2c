"""Series of one zone from drawn means whose errors are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from slopewatch.engine.series.alerts import read_alerts
from slopewatch.engine.series.tracking import Sighting, Track
from slopewatch.engine.series.zone_means import ZoneMeans
from slopewatch.engine.series.zone_series import zone_series

DAYS = np.array([0.0, 30.0, 60.0, 90.0])
ALERTS = read_alerts(None)
CELLS, AREA = np.arange(120), 30.0


def means(rate: float = -0.002, seed: int = 0, sigma: float = 0.003) -> ZoneMeans:
    """A zone of 30 m² that moves by ``rate`` metres a day; each survey's own error is ``sigma``."""
    rng = np.random.default_rng(seed)
    own = rng.normal(0, sigma, 4)
    change = rate * DAYS + own - own[0]
    seen = np.array([0.0, AREA, AREA, AREA])
    lowered, raised = (seen, 0 * seen) if rate < 0 else (0 * seen, seen)
    error = np.array([0.0, *[2**0.5 * sigma] * 3])
    return ZoneMeans(
        CELLS, AREA, change, np.full(4, sigma**2), change * AREA, error * AREA, np.ones(4), lowered, raised
    )


TRACK = Track("S001", -1, (Sighting(1, CELLS, "new"),), CELLS, "", "")


def series(given: ZoneMeans, track: Track = TRACK):
    return zone_series(track, given, DAYS, ALERTS, minimum_area=1.0)


def test_errors_hold_the_truth_as_often_as_they_say():
    rates = 0
    for seed in range(100):
        found = series(means(seed=seed))
        assert found.change[0] == found.error[0] == 0
        rates += found.velocity.low <= -0.002 <= found.velocity.high
    assert rates >= 90


def test_confirmed_needs_the_sign_the_level_and_the_area():
    given = means()
    assert series(given).confirmed.tolist() == [False, True, True, True]
    assert series(given, replace(TRACK, sign=1)).epochs_confirmed == 0
    little = replace(given, lowered=given.lowered / 100)
    assert series(little).epochs_confirmed == 0
    unsure = replace(given, variance=np.full(4, 0.2**2))
    assert series(unsure).epochs_confirmed == 0


def test_a_survey_that_did_not_measure_it_breaks_no_run():
    given = means()
    change, measured = given.change.copy(), given.measured.copy()
    change[2], measured[2] = np.nan, 0.0
    found = series(replace(given, change=change, measured=measured))
    assert found.confirmed.tolist() == [False, True, False, True]
    assert found.epochs_confirmed == 2
    assert found.last == 3
