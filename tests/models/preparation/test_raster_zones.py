"""Zones of score rasters: counted by hand, and levels that give as many false ones as were asked for."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from slopewatch.models.preparation.raster_zones import (
    Scores,
    common_levels,
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
