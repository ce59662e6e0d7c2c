"""Runs of comparisons that confirm, against a plain loop."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.series.persistence import confirmed_cells, longest_run


def test_runs_are_broken_by_a_denial_and_not_by_a_gap():
    assert longest_run([True, True, False, True], [True] * 4) == 2
    assert longest_run([True, False, True, True], [True, False, True, True]) == 3
    assert longest_run([], []) == 0
    assert longest_run([False], [True]) == 0


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
