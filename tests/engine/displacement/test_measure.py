"""How far relief must stand above zero, where hundreds of windows are asked."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from slopewatch.engine.displacement.measure import MAX_CHANCE_SHARE, MIN_INFORMATION, least_information


def test_one_window_of_a_plane_is_not_held_by_chance():
    plane = np.append(np.random.default_rng(1).normal(0.0, 1.0, 142).clip(max=2.5), 3.03)
    assert least_information(plane, 143) == float("inf")
    assert least_information(plane[-1:], 10) == MIN_INFORMATION  # among few, it stands out


def test_relief_leaves_the_least_as_it_is():
    assert least_information(np.random.default_rng(1).normal(6.0, 2.0, 150), 200) == MIN_INFORMATION


def test_windows_of_chance_are_few_among_those_held():
    rng, shares = np.random.default_rng(3), []
    for _ in range(300):
        flat, rough = rng.normal(0.0, 1.0, 20_000), rng.normal(4.0, 0.6, 30)
        least = least_information(np.concatenate([flat, rough]), 20_030)
        chance, held = (flat >= least).sum(), (rough >= least).sum()
        shares.append(chance / max(chance + held, 1))
    assert np.mean(shares) == pytest.approx(MAX_CHANCE_SHARE, abs=0.01)
    assert 20_000 * stats.norm.sf(MIN_INFORMATION) / 50 > MAX_CHANCE_SHARE  # which the least alone would not do


def test_nothing_to_hold():
    assert least_information(np.zeros(0), 50) == float("inf")
    assert least_information(np.array([9.0, 3.2]), 40) == pytest.approx(MIN_INFORMATION)
