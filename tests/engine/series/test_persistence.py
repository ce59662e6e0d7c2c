"""Runs of comparisons that confirm, against a plain loop."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.series.persistence import confirmed_cells, current_run, rest_since


def test_runs_are_broken_by_a_denial_and_not_by_a_gap():
    assert current_run([True, True, False, True], [True] * 4) == 1
    assert current_run([True, False, True, True], [True, False, True, True]) == 3
    assert current_run([], []) == 0
    assert current_run([False], [True]) == 0


def test_a_run_of_the_past_does_not_count():
    assert current_run([True, True, True, False], [True] * 4) == 0


@pytest.mark.parametrize(
    ("steps_mm", "since"),
    [
        ([100, 100, 0, 0], 2),
        ([100, 100, 0], None),  # one quiet interval only
        ([100, 100, 100, 100], None),
        ([100, 100, 20, 20], None),  # slower, but moving
        ([3, 3, 3, 3], None),  # a creep that never shows between two surveys
        ([0, 0, 0, 0], None),  # never moved
        ([100, 0, np.nan, 0, 0], 1),
        ([100, 100, -100], None),  # filled up again: level on the whole, not at rest
    ],
)
def test_what_rests_moved_before_and_does_not_now(steps_mm, since):
    steps = np.array(steps_mm) / 1000
    change = np.concatenate([[0.0], np.where(np.isnan(steps), np.nan, np.nancumsum(steps))])
    assert rest_since(30.0 * np.arange(len(change)), change, np.full(len(change), 0.004**2), 2) == since


def test_cells_agree_with_a_plain_loop():
    rng = np.random.default_rng(0)
    change = [np.where(rng.random((12, 9)) < 0.2, np.nan, rng.normal(0, 1, (12, 9))) for _ in range(7)]
    level = [np.full((12, 9), 0.5)] * 7
    found = confirmed_cells(change, level)
    for row, column in np.ndindex(12, 9):
        best = run = last = 0
        for dz, limit in zip(change, level, strict=True):
            value = dz[row, column]
            if np.isnan(value):
                continue
            sign = 0 if abs(value) <= limit[row, column] else int(np.sign(value))
            run = 0 if sign == 0 else run + 1 if sign == last else 1
            last = sign
            best = max(best, run)
        assert found[row, column] == best
