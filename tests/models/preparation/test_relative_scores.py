"""Log odds relative to the slope's own: what must not change them, against arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.models.preparation.relative_scores import LEVELS, SPREAD_POWER, level_for, relative_scores


def odds(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    up, down = rng.normal(-3, 1.5, (2, 40, 30))
    up[:5], down[:5] = np.nan, np.nan
    return up, down


def test_the_median_is_0_and_the_upper_quantile_a_power_of_the_spread() -> None:
    up, down = odds()
    scores = relative_scores(up, down, 0.5)
    both = np.stack([scores.uplift, scores.subsidence])
    known = both[np.isfinite(both)]
    assert len(known) == 2 * 35 * 30
    assert (known < 0).mean() == pytest.approx(0.5, abs=0.001)
    # Normal odds of scatter 1.5: 85 % lie below 1.036 scatters over the middle.
    assert (known > (1.036 * 1.5) ** (1 - SPREAD_POWER)).mean() == pytest.approx(0.15, abs=0.015)
    assert scores.area == 35 * 30 * 0.25


def test_another_level_changes_nothing_and_another_unit_less_than_it_is() -> None:
    up, down = odds()
    plain, other = relative_scores(up, down, 0.5), relative_scores(2.5 * up - 4, 2.5 * down - 4, 0.5)
    np.testing.assert_allclose(other.uplift, 2.5 ** (1 - SPREAD_POWER) * plain.uplift, atol=1e-12)
    np.testing.assert_allclose(other.subsidence, 2.5 ** (1 - SPREAD_POWER) * plain.subsidence, atol=1e-12)


def test_nothing_known_and_nothing_different_are_no_failure() -> None:
    nothing = np.full((3, 3), np.nan)
    assert np.isnan(relative_scores(nothing, nothing, 0.5).uplift).all()
    same = np.zeros((3, 3))
    assert (relative_scores(same, same, 0.5).uplift == 0).all()


def test_fewer_false_zones_need_a_higher_level() -> None:
    levels = [level_for(rate) for rate in (0.1, 0.15, 0.5, 1.0, 1.5, 10.0)]
    assert levels == sorted(levels, reverse=True)
    assert len(set(levels)) == len(levels)
    assert level_for(1.0) == LEVELS[1.0]
    assert level_for(0.01) == LEVELS[0.1]
