"""Sums over windows against sums over slices."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.window_sums import RunningSums, fixed_point


@pytest.mark.parametrize("radius", [0, 2, 30])
def test_totals_equal_sums_over_slices(radius):
    rng = np.random.default_rng(1)
    fields = [rng.integers(-9, 9, (13, 17)), rng.integers(0, 2**40, (13, 17))]
    sums = RunningSums(fields)
    row, column = (a.ravel() for a in np.indices((13, 17)))
    windows = sums.windows(row, column, radius)
    for number, field in enumerate(fields):
        expected = [
            field[max(i - radius, 0) : i + radius + 1, max(j - radius, 0) : j + radius + 1].sum()
            for i, j in zip(row, column, strict=True)
        ]
        assert sums.total(number, windows).tolist() == expected


def test_a_running_sum_that_overflows_still_gives_the_sums_over_windows():
    field = np.full((40, 40), 2**58)
    sums = RunningSums([field])
    place = np.array([20]), np.array([30])
    assert sums.total(0, sums.windows(*place, 2)).tolist() == [25 * 2**58]


def test_whole_units_are_as_fine_as_the_largest_sum_allows():
    values = np.array([-1234.56789, 0.0, 1e-9, 999.0])
    whole, unit = fixed_point(values, 1e6)
    assert whole * unit == pytest.approx(values, abs=1e-12)
    assert 1e6 / unit < 2**63
