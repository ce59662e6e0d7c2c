"""Levels through time: reached at once, kept for a survey, withdrawn with a reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.series.alerts import read_alerts
from slopewatch.engine.series.level_history import Displacements, level_history

TABLE, SIGMA = read_alerts(None), 0.003


def zone(*steps_mm: float, every: float = 30.0, area: float = 1.0) -> Displacements:
    steps = np.array(steps_mm) / 1000
    change = -np.concatenate([[0.0], np.where(np.isnan(steps), np.nan, np.nancumsum(steps))])
    n = len(change)
    with np.errstate(invalid="ignore"):
        confirmed = -change > 1.96 * 2**0.5 * SIGMA
    return Displacements(every * np.arange(n), change, np.full(n, SIGMA**2), confirmed, np.full(n, area))


def test_a_level_is_reached_with_the_second_confirmation_and_says_by_what():
    found = level_history(zone(200, 200, 200), TABLE)
    assert found.levels == (0, 0, 3, 3)
    assert found.states == ("", "", "reached", "reached")
    assert found.reasons[2] == "rate 203 mm/month, beyond 134 with an error chance of 0.1 %"


def test_what_stopped_is_withdrawn_after_two_quiet_surveys():
    found = level_history(zone(200, 200, 200, 0, 0, 0), TABLE)
    assert found.levels == (0, 0, 3, 3, 3, 0, 0)
    assert found.states[3:] == ("reached", "kept", "withdrawn", "withdrawn")
    assert found.reasons[4] == f"kept after 1 of 2 surveys below the level; before: {found.reasons[3]}"
    assert found.reasons[-1] == "level 3 withdrawn: no motion seen for 2 surveys or more"


def test_the_reason_of_a_kept_level_is_said_once():
    slower = tuple(replace(row, quiet_surveys=3) for row in TABLE)
    found = level_history(zone(200, 200, 200, 60, 60), slower)
    assert found.states[-2:] == ("kept", "kept")
    assert found.reasons[-1] == f"kept after 2 of 3 surveys below the level; before: {found.reasons[3]}"


def test_what_was_repaired_is_withdrawn():
    found = level_history(zone(200, 200, -400, 0, 0), TABLE)
    assert found.levels == (0, 0, 3, 3, 0, 0)
    assert "withdrawn" in found.reasons[-1]


def test_what_got_slower_falls_to_what_it_still_reaches():
    found = level_history(zone(200, 200, 60, 60, 60), TABLE)
    assert found.levels == (0, 0, 3, 3, 2, 2)
    assert found.reasons[4] == "level 3 withdrawn: the last 2 surveys do not reach it"


def test_a_survey_without_measurement_changes_nothing():
    found = level_history(zone(200, 200, 0, np.nan, 0), TABLE)
    assert found.levels == (0, 0, 3, 3, 3, 0)


def test_what_came_to_rest_does_not_flutter():
    rng = np.random.default_rng(6)
    still = zone(*[200] * 3, *[0] * 8)
    again = 0
    for _ in range(60):
        errors = rng.normal(0, SIGMA, 12)
        levels = level_history(replace(still, change=still.change + errors - errors[0]), TABLE).levels
        again += max(levels[7:]) > 0
    assert again <= 2


def test_an_error_after_rest_is_not_confirmed_by_the_old_change():
    found = level_history(zone(200, 200, 0, 0, 20), TABLE)  # 20 mm are 4 standard errors in one survey
    assert found.levels[-3:] == (3, 0, 0)
    assert level_history(zone(200, 200, 0, 0, 20, 0), TABLE).levels[-2:] == (0, 1)
    again = level_history(zone(200, 200, 0, 0, 20, 20), TABLE)
    assert again.levels[-2:] == (0, 1)
    assert again.reasons[-1].startswith("confirmed by 2 comparisons since the zone was at rest")


def test_rest_is_judged_at_the_chance_of_the_level():
    stopped = zone(200, 200, 200, 4, 5)  # 9 mm in two intervals are 2.1 standard errors: one series in 30 has them
    assert level_history(stopped, TABLE).levels[-1] == 0
    surer = tuple(replace(row, chance_percent=2.5) for row in TABLE)
    assert level_history(stopped, surer).levels[-1] > 0


def test_a_repair_alone_is_no_rest():
    found = level_history(zone(100, 100, -100), TABLE)  # 100, 200 and 100 mm are level on the whole
    assert found.states[-1] == "kept"


def test_it_rises_again():
    assert level_history(zone(200, 200, 0, 0, 200, 200), TABLE).levels == (0, 0, 3, 3, 0, 3, 3)


def test_a_single_large_event_needs_no_confirmation_and_ends():
    found = level_history(zone(0, 300, 0, 0, 0, area=400.0), TABLE)
    assert found.levels == (0, 0, 3, 3, 0, 0)
    assert found.reasons[2].startswith("volume 120.0 m³ since the survey before")


def test_a_volume_that_grew_slowly_is_no_event():
    assert max(level_history(zone(*[24] * 10, area=400.0), TABLE).levels) == 1  # 96 m³ in all, 10 m³ at a time


def test_a_later_survey_changes_no_earlier_level():
    whole = zone(50, 20, 90, 0, 0, 100, 150)
    found = level_history(whole, TABLE)
    for last in range(2, 8):
        arrays = ("days", "change", "variance", "confirmed", "area")
        part = replace(whole, **{name: getattr(whole, name)[:last] for name in arrays})
        assert level_history(part, TABLE).levels == found.levels[:last]


@pytest.mark.parametrize("rate", [0.5, 2.0, 4.0])
def test_constant_creep_never_reaches_level_3(rate):
    rng = np.random.default_rng(4)
    for _ in range(40):
        moving = zone(*[30 * rate] * 7)
        errors = rng.normal(0, SIGMA, 8)
        drawn = replace(moving, change=moving.change + errors - errors[0])
        assert max(level_history(drawn, TABLE).levels) <= 2


def test_an_acceleration_to_failure_reaches_level_3_before_it():
    days = np.array([0.0, 30, 60, 90, 120, 150])
    way = -1000 * 0.2 * np.diff(np.log((160 - days) / 160))
    found = level_history(zone(*way), TABLE)
    assert found.levels[-1] >= 3
    assert "a steady motion looks so with a chance of" in found.reasons[-1]
