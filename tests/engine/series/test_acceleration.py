"""The test for a motion that gets faster: its false-alarm rate is the stated one, and steps are no acceleration."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.series.acceleration import acceleration

DAYS, SIGMA = 30.0 * np.arange(8), 0.006
VARIANCE = np.full(8, SIGMA**2)


def surveyed(motion: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    y = motion + rng.normal(0, SIGMA, len(motion))
    return y - y[0]


@pytest.mark.parametrize("onset", [-1.0, 0.0, 20.0, 75.0, 160.0])
@pytest.mark.parametrize("rate", [0.0, 0.001, -0.004])
def test_a_steady_motion_looks_faster_no_more_often_than_stated(onset, rate):
    rng = np.random.default_rng(0)
    motion = rate * np.maximum(DAYS - onset, 0)
    chances = np.array([acceleration(DAYS, surveyed(motion, rng), VARIANCE).chance for _ in range(400)])
    assert np.mean(chances <= 0.05) <= 0.06
    assert np.mean(chances <= 0.005) <= 0.0075


def test_an_acceleration_is_found():
    rng = np.random.default_rng(1)
    motion = -0.2 * np.log((225 - DAYS) / 225)
    chances = [acceleration(DAYS, surveyed(motion, rng), VARIANCE).chance for _ in range(50)]
    assert np.mean(np.array(chances) <= 0.001) >= 0.9


def test_a_step_after_others_is_none_until_it_is_much_faster():
    steps = np.array([0, 0.0, 0.1, 0.0, 0.0, 0.03, 0.12])
    last = {0.12: "step-like", 0.5: ""}
    for size, reason in last.items():
        steps[-1] = size
        found = acceleration(DAYS, np.concatenate([[0], np.cumsum(steps)]), VARIANCE)
        assert reason in found.reason
        assert (found.chance < 0.001) == (not reason)
