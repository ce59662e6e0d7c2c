"""Zones of score rasters: counted by hand, and levels that give as many false ones as were asked for."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from slopewatch.models.preparation.raster_zones import (
    Scores,
    common_levels,
    conformal_level,
    level_for_rate,
    strength_at,
    zone_counts,
    zones_above,
)


def noise(seed: int, side: int = 200) -> Scores:
    field = gaussian_filter(np.random.default_rng(seed).normal(size=(side, side)), 2.0)
    return Scores.signed(field / field.std(), 0.5)


def test_small_groups_are_no_zones_and_corners_connect() -> None:
    score = np.zeros((12, 12))
    score[1:3, 1:3] = 5  # 1 m²
    score[6, 6] = score[7, 7] = score[8, 8] = score[9, 9] = 5  # 1 m² by its corners
    score[1, 9:12] = 5  # 0.75 m²
    score[11, 0] = np.nan
    zones, count = zones_above(score, 4.0, 0.5)
    assert count == 2
    assert (zones > 0).sum() == 8
    assert zones[1, 10] == 0
    assert zone_counts(Scores.signed(score, 0.5), np.array([4.0, 5.0])).tolist() == [2.0, 0.0]
    assert zone_counts(Scores.signed(-score, 0.5), np.array([4.0])).tolist() == [2.0]


def test_the_level_gives_the_rate_on_new_ground() -> None:
    seen = [noise(seed) for seed in range(4)]  # 10,000 m² each
    levels = common_levels(seen)
    assert (np.diff(levels) >= 0).all()
    area = sum(one.area for one in seen)
    rates = sum(zone_counts(one, levels) for one in seen) / area * 1000
    level = level_for_rate(levels, rates, area)
    new = [noise(seed) for seed in range(50, 58)]
    found = sum(zone_counts(one, np.array([level]))[0] for one in new) / sum(one.area for one in new) * 1000
    assert found == pytest.approx(1.0, abs=0.35)


def test_on_a_small_ground_the_tail_is_continued() -> None:
    whole = [noise(seed) for seed in range(6)]
    levels = common_levels(whole)
    area = sum(one.area for one in whole)
    truth = level_for_rate(levels, sum(zone_counts(one, levels) for one in whole) / area * 1000, area)
    found = []
    for seed in range(10, 18):
        small = noise(seed, side=50)  # 625 m²
        own = common_levels([small])
        found.append(level_for_rate(own, zone_counts(small, own) / small.area * 1000, small.area))
    # The tail of normal scores is lighter than the one continued.
    assert truth - 0.1 < np.median(found) < 1.25 * truth


def test_the_conformal_level_keeps_its_promise_on_new_slopes() -> None:
    """Slopes whose scores scatter differently, so that the mean rate alone would promise too much."""

    def rates(seed: int, levels: np.ndarray) -> np.ndarray:
        scale = np.random.default_rng([seed, 1]).lognormal(0.0, 0.25)
        one = noise(seed, side=100)
        return zone_counts(Scores(one.uplift * scale, one.subsidence * scale, 0.5), levels) / one.area * 1000

    levels = np.linspace(0.5, 8.0, 76)
    known, new = (np.array([rates(seed, levels) for seed in seeds]) for seeds in (range(20), range(100, 160)))
    level = conformal_level(levels, known, 1.0, 3.0)
    at = int(np.searchsorted(levels, level))
    assert np.minimum(new[:, at], 3.0).mean() <= 1.0
    # one level lower the bound is not kept: it is not just any high level
    below = np.minimum(known[:, at - 1], 3.0)
    assert (below.sum() + 3.0) / 21 > 1.0
    assert conformal_level(levels, known, 0.5, 3.0) > level
    assert np.isnan(conformal_level(levels, known, 0.1, 3.0))


def test_the_strength_is_the_highest_level_that_finds_it() -> None:
    score = np.zeros((40, 40))
    score[10:13, 10:13] = [[3, 4, 3], [4, 9, 4], [3, 4, 3]]
    footprint = np.zeros((40, 40), dtype=bool)
    footprint[8:15, 8:15] = True
    # At 4 there are five cells, at 9 only one.
    assert strength_at(score, footprint, 0.5) == 4
    found = [level for level in (3, 4, 9) if (zones_above(score, level - 1e-9, 0.5)[0][footprint] > 0).sum() >= 4]
    assert max(found) == 4
    far = np.zeros((40, 40), dtype=bool)
    far[30:36, 30:36] = True
    assert strength_at(np.where(score > 0, score, np.nan), far, 0.5) == -np.inf
    assert strength_at(score, np.zeros((40, 40), dtype=bool), 0.5) == -np.inf


def hilly(seed: int) -> np.ndarray:
    """Scores with hills of some metres, so that zones of one level run together at a lower one."""
    field = gaussian_filter(np.random.default_rng(seed).normal(size=(60, 60)), 1.5)
    return field / field.std()


def test_with_an_outline_a_zone_is_as_wide_as_that_and_must_still_pass_the_level() -> None:
    """Against a flood fill by hand."""
    score = hilly(3)
    zones, count = zones_above(score, 2.0, 0.5, 1.0)
    kept = np.zeros(score.shape, dtype=bool)
    number = 0
    left = {(int(i), int(j)) for i, j in np.argwhere(score > 1.0)}
    while left:
        wave = [left.pop()]
        group = set(wave)
        while wave:
            i, j = wave.pop()
            near = {(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1)} & left
            left -= near
            group |= near
            wave += near
        if sum(score[place] > 2.0 for place in group) * 0.25 >= 1.0:
            number += 1
            kept[tuple(np.array(list(group)).T)] = True
    assert count == number > 2
    np.testing.assert_array_equal(zones > 0, kept)
    assert number <= zones_above(score, 2.0, 0.5)[1]
    # An outline above the level changes nothing.
    np.testing.assert_array_equal(zones_above(score, 2.0, 0.5, 2.5)[0], zones_above(score, 2.0, 0.5)[0])
    both = Scores.signed(score, 0.5, 1.0)
    assert zone_counts(both, np.array([2.0])).tolist() == [count + zones_above(-score, 2.0, 0.5, 1.0)[1]]


def test_the_strength_with_an_outline_is_the_highest_level_that_finds_it() -> None:
    found = []
    for seed in range(6):
        score, footprint = hilly(seed), np.zeros((60, 60), dtype=bool)
        footprint[20:24, 30:36] = True
        strength = strength_at(score, footprint, 0.5, 0.8)
        for level in (strength - 1e-9, strength + 1e-9):
            zones, count = zones_above(score, level, 0.5, 0.8)
            overlap = np.bincount(zones[footprint], minlength=count + 1)[1:].max(initial=0)
            found.append((overlap >= 4) == (level < strength))
        assert strength >= strength_at(score, footprint, 0.5)
    assert all(found)
