"""Tangent angles of motions whose ratio of velocities is known."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.series.tangent_angle import ORANGE_RATIO, RED_RATIO, tangent_angle

DAYS = np.array([0.0, 30.0, 60.0, 90.0, 120.0])
TIGHT = np.full(5, 0.001**2)


def motion(ratio: float, v0: float = -0.003) -> np.ndarray:
    return np.append(v0 * DAYS[:4], v0 * (90 + 30 * ratio))


def test_limits_are_those_of_the_reference():
    assert (round(ORANGE_RATIO, 1), round(RED_RATIO, 1)) == (5.7, 11.4)


@pytest.mark.parametrize(
    ("ratio", "level", "degrees"),
    [(1.0, "blue", 45.0), (0.2, "blue", 11.31), (2.0, "yellow", 63.43), (6.0, "orange", 80.54), (12.0, "red", 85.24)],
)
def test_angle_and_level(ratio, level, degrees):
    found = tangent_angle(DAYS, motion(ratio), TIGHT)
    assert found.level == level
    assert found.degrees == pytest.approx(degrees, abs=0.01)
    assert found.low < found.degrees < found.high


def test_a_faster_velocity_within_chance_stays_blue():
    assert tangent_angle(DAYS, motion(1.5), np.full(5, 0.02**2)).level == "blue"


def test_interval_holds_the_true_ratio():
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(500):
        y = motion(3.0) + rng.normal(0, 0.006, 5)
        found = tangent_angle(DAYS, y - y[0], np.full(5, 0.006**2))
        held += found.low <= np.degrees(np.arctan(3.0)) <= found.high
    assert held / 500 >= 0.93


@pytest.mark.parametrize(
    ("change", "start", "reason"),
    [
        (0 * DAYS, 0, "velocity before"),
        (motion(2.0), 2, "3 surveys in motion, at least 4"),
        (np.where(DAYS == 60, np.nan, motion(2.0)), 1, "3 surveys in motion"),
    ],
)
def test_reason_where_it_cannot_be_computed(change, start, reason):
    found = tangent_angle(DAYS, change, TIGHT, start)
    assert (found.degrees, found.level) == (None, "")
    assert found.reason.startswith("not computable")
    assert reason in found.reason
