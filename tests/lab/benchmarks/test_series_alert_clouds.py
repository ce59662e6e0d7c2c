"""Still slopes whose grass grows and is cut, and real ground dealt out to surveys."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from slopewatch.lab.benchmarks import series_alert_clouds as clouds


def test_grass_is_surveyed_over_two_years_low_high_and_cut():
    plans = [clouds.grass_plan(seed) for seed in range(2100, 2110)]
    states, heights = set(), []
    for dates, plants, _ in plans:
        assert 6 <= len(dates) == len(plants) <= 8
        assert 640 <= (dates[-1] - dates[0]).days <= 790
        assert all(later > day for day, later in pairwise(dates))
        states |= {of_day.mown for of_day in plants}
        heights += [of_day.grass_height for of_day in plants if of_day.mown == "never"]
    assert states == {"never", "both"}
    assert min(heights) == pytest.approx(0.15)
    assert max(heights) > 0.5
    assert {plants[0].grass for _, plants, _ in plans} == {0.5, 0.6, 0.7, 1.0}


def test_grass_grows_from_survey_to_survey_and_the_ground_stays():
    dates, plants, buffer = clouds.grass_plan(2100)
    low, high = sorted(range(len(dates)), key=lambda i: 0.0 if plants[i].mown == "both" else plants[i].grass_height)[
        ::6
    ]
    first, last = sorted((low, high))
    series = clouds.grown_series((dates[first], dates[last]), (plants[first], plants[last]), buffer, points=4000)
    assert all(ground.base is series.scene.base for ground in series.grounds)
    tops = []
    for ground, cloud, to_first in zip(series.grounds, series.clouds, series.transforms, strict=True):
        xyz = to_first.apply(cloud.xyz)
        tops.append(float(np.quantile(xyz[:, 2] - ground.height_at(xyz), 0.9)))
    assert (tops[0] < tops[1]) == (first == low)
    assert abs(tops[1] - tops[0]) > 0.05


def test_real_surveys_share_no_point():
    for name, _, parts in clouds.real_surveys():
        assert len(parts) >= 4, name
        first, second = (set(map(tuple, part[:2000])) for part in parts[:2])
        assert not first & second
