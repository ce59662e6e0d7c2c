"""What the benchmark of bumps in real strips takes for true, and counts."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.grid.grid import Grid
from slopewatch.lab.benchmarks.bumps import Found, halves, table, true_heights
from slopewatch.lab.benchmarks.strips import HEIGHTS, RADIUS, Strips


def test_true_heights_hold_the_volumes_of_the_bumps():
    places = np.column_stack([np.arange(6) * 20.0 + 10.3, np.full(6, 12.1)])
    grid = Grid(0.0, 26.0, 0.5, 52, 250)
    whole = true_heights(places, grid).sum() * 0.25
    one = np.pi * RADIUS**2 * (0.5 - 2 / np.pi**2)
    assert whole == pytest.approx(one * sum(HEIGHTS), rel=1e-3)
    first = true_heights(places, grid)[:, :40]
    assert first.sum() * 0.25 == pytest.approx(one * HEIGHTS[0], rel=1e-3)
    row, column = np.unravel_index(first.argmax(), first.shape)
    assert (0.5 * (column + 0.5), 26 - 0.5 * (row + 0.5)) == pytest.approx((10.25, 12.25))


def test_halves_share_no_point_and_leave_none():
    points = np.random.default_rng(1).random((1000, 3))
    made = halves(Strips(points, points, points, 0.01))
    assert len(made.first) + len(made.second) == 1000
    assert 400 < len(made.first) < 600
    assert not {tuple(p) for p in made.first} & {tuple(p) for p in made.second}
    assert made.registered is made.second


def test_rows_compare_with_the_targets():
    good = Found(6, 6, 0, 6, 6, (1.0,) * 6, 1.5, 0.4, 5.0)
    off = Found(5, 6, 1, 4, 6, (1.4,) * 6, 4.0, 1.0, 5.0)
    first = table("here", [good, good, off])
    assert [row.met for row in first] == [False, False, True]
    assert first[0].value == "17 found, 1 false zones"
    assert "1.5 mm, in height 0.4 (largest 4.0" in first[2].value
    assert first[1].value == "16 of 18 (88.9 %)"
