"""Surveys of several dates against plants that let a known share of the pulses pass."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.flight.season import Counted, counted, ratio_of_strips, season_of, strip_counts
from slopewatch.engine.flight.terrain import terrain_of_points
from slopewatch.engine.grid.grid import Grid

GRID = Grid(0.0, 60.0, 2.0, 30, 30)
WHOLE = np.ones(GRID.shape, dtype=bool)


def survey(month: int, passing: float, density: float = 30.0, *, year: int = 2025, seed: int = 0, patch: float = 0.0):
    """Pulses of which a share passes; with ``patch`` the share varies by so much between squares of 10 m."""
    rng = np.random.default_rng([seed, month, year])
    share = np.clip(passing + patch * np.kron(rng.choice([-1, 1], (6, 6)), np.ones((5, 5))), 0, 1)
    pulses = rng.poisson(density * GRID.cell**2, GRID.shape)
    return Counted(date(year, month, 10), pulses, rng.binomial(pulses, share), 1.5)


def test_the_month_with_the_most_ground_is_named_and_its_shares_are_the_truth() -> None:
    found = season_of([survey(7, 0.2), survey(3, 0.55), survey(11, 0.4)], GRID, WHOLE)
    assert (found.best, found.worst, found.reason, found.also) == (3, 7, "", ())
    assert found.months == pytest.approx({3: 0.55, 7: 0.2, 11: 0.4}, abs=0.01)
    assert [s.day.month for s in found.surveys] == [3, 7, 11]
    assert found.ratio == pytest.approx(0.55 / 0.2, rel=0.05)
    assert found.surveys[0].pulses == pytest.approx(30.0, rel=0.02)
    assert found.surveys[1].without_ground == pytest.approx(np.exp(-30 * 4 * 0.2), abs=1e-3)


def test_the_share_counts_and_not_the_number_of_pulses() -> None:
    found = season_of([survey(7, 0.2, 200.0), survey(3, 0.5, 20.0)], GRID, WHOLE)
    assert found.best == 3
    assert found.surveys[1].ground > found.surveys[0].ground


def test_months_nearly_as_good_are_named_too_and_years_are_averaged() -> None:
    found = season_of([survey(2, 0.5), survey(2, 0.6, year=2024), survey(3, 0.53), survey(8, 0.1)], GRID, WHOLE)
    assert (found.best, found.also, found.worst) == (2, (3,), 8)
    assert found.months[2] == pytest.approx(0.55, abs=0.01)


@pytest.mark.parametrize(
    ("surveys", "reason"),
    [
        ([survey(5, 0.4)], "one survey"),
        ([survey(5, 0.4), survey(5, 0.2, year=2024)], "one month"),
        ([survey(5, 0.40), survey(9, 0.42)], "alike"),
        # 20 % apart, by patches that differ by more
        ([survey(5, 0.40, patch=0.3, seed=2), survey(9, 0.48, patch=0.3, seed=3)], "alike"),
    ],
)
def test_nothing_is_named_where_the_surveys_do_not_tell(surveys: Sequence[Counted], reason: str) -> None:
    found = season_of(surveys, GRID, WHOLE)
    assert (found.best, found.worst, found.also, found.reason) == (None, None, (), reason)


def test_the_error_of_the_difference_is_what_repeated_surveys_scatter_by() -> None:
    """Plants in patches of 10 m: forty pairs of them, against the mean of the errors stated."""
    pairs = [
        season_of([survey(3, 0.5, seed=n, patch=0.2), survey(8, 0.3, seed=n + 100, patch=0.2)], GRID, WHOLE)
        for n in range(40)
    ]
    scatter = np.std([pair.months[3] - pair.months[8] for pair in pairs])
    assert np.mean([pair.error for pair in pairs]) == pytest.approx(scatter, rel=0.3)


def test_only_places_that_all_surveys_saw_are_compared() -> None:
    near, half = survey(3, 0.5), survey(7, 0.3)
    pulses, ground = near.pulses.copy(), near.ground.copy()
    pulses[:, 15:], ground[:, 15:] = 0, 0
    found = season_of([Counted(near.day, pulses, ground, 0.0), half], GRID, WHOLE)
    assert found.area == 30 * 15 * 4.0
    tiny = np.zeros_like(WHOLE)
    tiny[:5, :10] = True
    assert season_of([near, half], GRID, tiny).reason == "small"
    apart = np.broadcast_to(np.arange(30) >= 15, WHOLE.shape)
    assert season_of([Counted(near.day, pulses, ground, 0.0), half], GRID, apart).reason == "small"


def test_plants_are_measured_above_the_ground_of_their_own_survey() -> None:
    """Plants 0 to 2 m high over a slope; a survey that lies 3 m too high says the same."""
    rng = np.random.default_rng(5)
    xy = rng.uniform(0, 60, (80_000, 2))
    ground = np.column_stack([xy, 0.7 * xy[:, 0]])
    plants = ground[:40_000] + np.column_stack([np.zeros((40_000, 2)), rng.uniform(0, 2, 40_000)])
    for shift in (0.0, 3.0):
        up = np.array([0, 0, shift])
        terrain = terrain_of_points(ground + up, CRS.from_epsg(32651), Path("ground.laz"), 5.0)
        first = np.concatenate([ground, plants]) + up
        found = counted(date(2025, 6, 1), GRID, first, ground + up, plants + up, terrain, WHOLE)
        assert found.plants == pytest.approx(1.9, abs=0.05)
        assert found.pulses.sum() == 120_000
        assert found.ground.sum() == 80_000


def with_strips(whole: Counted, times_more: float, seed: int = 0) -> Counted:
    """The survey as two strips over all places, the first of which sees ``times_more`` as much ground as the second."""
    rng = np.random.default_rng(seed)
    pulses = rng.binomial(whole.pulses, 0.5)
    share = whole.ground.sum() / whole.pulses.sum()
    low = 2 * share / (1 + times_more)
    ground = rng.binomial(pulses, low * times_more), rng.binomial(whole.pulses - pulses, low)
    strips = ((pulses, ground[0]), (whole.pulses - pulses, ground[1]))
    return replace(whole, ground=ground[0] + ground[1], strips=strips)


def test_months_that_differ_by_no_more_than_strips_of_one_day_are_not_told_apart() -> None:
    for times_more, ratio, reason in ((1.4, 1.3, "strips"), (1.4, 1.6, ""), (1.0, 1.3, "")):
        pair = [with_strips(survey(3, 0.3 * ratio), times_more), with_strips(survey(8, 0.3), 1.0, 1)]
        found = season_of(pair, GRID, WHOLE)
        assert found.strip_ratio == pytest.approx(times_more, abs=0.03)
        assert (found.reason, found.best) == (reason, None if reason else 3)


def test_strips_are_compared_where_both_saw_the_ground() -> None:
    one = with_strips(survey(3, 0.4), 1.5)
    assert ratio_of_strips(one, WHOLE) == pytest.approx(1.5, abs=0.03)
    assert math.isnan(ratio_of_strips(survey(3, 0.4), WHOLE)), "the strips are not known"
    (pulses, ground), second = one.strips
    west = np.broadcast_to(np.arange(30) < 28, WHOLE.shape)
    apart = replace(one, strips=((pulses * west, ground * west), tuple(band * ~west for band in second)))
    assert math.isnan(ratio_of_strips(apart, WHOLE))
    assert math.isnan(ratio_of_strips(one, ~west)), "60 places are too few"
    # where the strips see alike, but one of them alone sees a dense part
    dense = replace(one, strips=((pulses, pulses // 2), (second[0] * west, second[0] * west // 2)))
    assert ratio_of_strips(dense, WHOLE) == pytest.approx(1.0, abs=0.02)


def test_strips_are_counted_by_their_numbers() -> None:
    rng = np.random.default_rng(2)
    first, ground = (np.column_stack([rng.uniform(0, 60, (n, 2)), np.zeros(n)]) for n in (3000, 1000))
    sources = rng.choice([7, 9], 3000), rng.choice([7, 9], 1000)
    strips = strip_counts(GRID, first, ground, *sources)
    for number, (pulses, returns) in zip((7, 9), strips, strict=True):
        assert pulses.sum() == (sources[0] == number).sum()
        assert returns.sum() == (sources[1] == number).sum()
    terrain = terrain_of_points(ground, CRS.from_epsg(32651), Path("ground.laz"), 5.0)
    whole = counted(date(2025, 6, 1), GRID, first, ground, None, terrain, WHOLE)
    assert np.array_equal(sum(pulses for pulses, _ in strips), whole.pulses)
