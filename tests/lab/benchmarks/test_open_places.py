"""The offset of two surveys at places where nothing grows, on planes with a known one."""

from __future__ import annotations

import math

import numpy as np
from slopewatch.lab.benchmarks.open_places import offset_of_open_places

GROWN = 24.0
"""Trees stand from here on, m."""


def survey(seed: int, lift: float = 0.0, bare: float = GROWN) -> np.ndarray:
    """A slope of 40 m by 30 m with 4 returns a m²; where trees stand, most returns are above the ground."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 1, (4800, 3)) * [40.0, 30.0, 0.0]
    xyz[:, 2] = 0.6 * xyz[:, 1] + lift + 0.02 * rng.standard_normal(len(xyz))
    grown = (xyz[:, 0] > bare) & (rng.uniform(size=len(xyz)) < 0.7)
    xyz[grown, 2] += rng.uniform(0.3, 8.0, int(grown.sum())) + 5.0 * lift
    return xyz


def test_the_offset_of_open_places_is_that_of_the_surveys_and_its_error_holds():
    found = [offset_of_open_places(survey(seed), survey(seed + 50, 0.03)) for seed in range(6)]
    assert all(100 < count <= 12 * 15 for _, _, count in found), "squares of 2 m on 24 m by 30 m; trees add none"
    scores = np.array([(mean - 0.03) / error for mean, error, _ in found])
    assert np.sqrt(np.mean(scores**2)) < 2.0
    assert max(error for _, error, _ in found) < 0.002


def test_without_open_places_the_offset_is_not_known():
    mean, error, count = offset_of_open_places(survey(1, bare=0.0), survey(2, bare=0.0))
    assert count < 8
    assert math.isnan(mean)
    assert math.isnan(error)
