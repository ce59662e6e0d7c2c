"""The series with known truth that alert levels are measured on."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.series.alerts import read_alerts
from slopewatch.lab.benchmarks.series_alert_cases import KINDS, cases
from slopewatch.lab.benchmarks.series_alerts import METHODS, confirmed_forecast, forecast, judge

TABLE = read_alerts(None)


def test_there_are_sixty_series_of_every_kind_with_4_to_20_surveys():
    made = cases()
    assert len(made) >= 60
    assert {case.kind for case in made} == set(KINDS)
    counts = [len(case.days) for case in made]
    assert (min(counts), max(counts)) == (4, 20)
    assert all(len(case.highest) == len(case.lowest) == len(case.days) for case in made)
    assert all(np.all(np.diff(case.days) > 0) for case in made)


def test_a_failing_series_is_surveyed_until_less_than_an_interval_before():
    for case in cases(("failing", "failing, along the surface")):
        assert 0 < case.failure - case.days[-1] <= np.median(np.diff(case.days))
        assert case.lowest[-1] == 3
        speed = np.abs(np.diff(case.truth) / np.diff(case.days))
        assert speed[-1] > 2 * speed[0]


def test_each_drawing_has_its_own_errors_of_the_stated_size():
    (case, *_) = cases(("still, changing noise",), 2)[1:]
    assert case.surveyed(1)[0].change == pytest.approx(case.surveyed(1)[0].change)
    errors = np.concatenate(
        [z.change / np.sqrt(z.variance + z.variance[0]) for d in range(30) for z in case.surveyed(d)]
    )
    assert 0.8 < np.std(errors[errors != 0]) < 1.25
    first = [case.surveyed(d)[0].change[2] for d in range(40)]
    second = [case.surveyed(d)[1].change[2] for d in range(40)]
    assert np.corrcoef(first, second)[0, 1] > 0.4  # zones of a slope share the survey's registration


def test_a_case_is_judged_as_by_the_product_and_by_each_method():
    case = cases(("failing",))[3]
    zone = case.surveyed(0)[0]
    found = judge(case, zone, TABLE)
    assert found.levels[-1] >= 3
    assert found.interval[-1, 0] > case.days[-1] - 1e-9
    for column, by in METHODS.values():
        assert column in ("rate_mm_day", "tangent_angle_deg", "failure_within_days")
        assert len(judge(case, zone, TABLE, by=by).levels) == len(case.days)


def test_life_expectancy_needs_two_forecasts_that_agree():
    case = cases(("failing",))[3]
    zone, last = case.surveyed(0)[0], len(case.days) - 1
    stated = [survey for survey in range(1, last + 1) if forecast(zone, survey) is not None]
    confirmed = [survey for survey in range(1, last + 1) if confirmed_forecast(zone, survey) is not None]
    assert stated
    assert set(confirmed) <= set(stated)
    assert stated[0] not in confirmed
