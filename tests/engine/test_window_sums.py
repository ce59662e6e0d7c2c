"""Sums over windows against sums over slices."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.window_sums import RunningSums, fixed_point, windows_around


@pytest.mark.parametrize("radius", [0, 2, 30])
def test_totals_equal_sums_over_slices(radius):
    rng = np.random.default_rng(1)
    fields = [rng.integers(-9, 9, (13, 17)), rng.integers(0, 2**40, (13, 17))]
    sums = RunningSums(fields)
    row, column = (a.ravel() for a in np.indices((13, 17)))
    totals = sums.totals(windows_around(row, column, radius, (13, 17)))
    for total, field in zip(totals, fields, strict=True):
        expected = [
            field[max(i - radius, 0) : i + radius + 1, max(j - radius, 0) : j + radius + 1].sum()
            for i, j in zip(row, column, strict=True)
        ]
        assert total.tolist() == expected


def test_a_running_sum_that_overflows_still_gives_the_sums_over_windows():
    place = windows_around(np.array([20]), np.array([30]), 2, (40, 40))
    for value in (np.int64(2**58), np.int32(2**26)):
        (total,) = RunningSums([np.full((40, 40), value)]).totals(place)
        assert total.tolist() == [25 * int(value)]


def test_whole_units_are_as_fine_as_the_largest_sum_allows():
    values = np.array([-1234.56789, 0.0, 1e-9, 999.0])
    whole, unit = fixed_point(values, 1e6)
    assert whole * unit == pytest.approx(values, abs=1e-12)
    assert 1e6 / unit < 2**63
