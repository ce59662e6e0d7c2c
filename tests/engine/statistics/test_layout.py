"""Values of some cells of a grid, against the same on the whole grid."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.statistics.layout import Layout, bands, layout_of

rng = np.random.default_rng(8)
SHAPE = (23, 17)
HELD = rng.random(SHAPE) < 0.3
LISTED = Layout(SHAPE, np.flatnonzero(HELD))
NUMBERS = np.where(HELD, rng.integers(1, 9, SHAPE), 0).astype(np.int32)
HEIGHTS = np.where(HELD, rng.normal(size=SHAPE), np.nan)


@pytest.mark.parametrize("whole", [NUMBERS, HEIGHTS, HELD], ids=["numbers", "heights", "marks"])
def test_what_is_listed_comes_back_on_the_grid(whole):
    values = LISTED.of(whole)
    assert values.shape == LISTED.array_shape == (HELD.sum(),)
    np.testing.assert_array_equal(LISTED.on_grid(values), whole)
    assert LISTED.on_grid(values).dtype == whole.dtype
    for window in ((slice(3, 9), slice(5, 99)), (slice(0, 23), slice(16, 17)), (slice(4, 4), slice(0, 3))):
        np.testing.assert_array_equal(LISTED.window(values, window), whole[window])
    np.testing.assert_array_equal(LISTED.lines(values, slice(7, 12)), whole[7:12])
    row, column = rng.integers(0, SHAPE[0], 60), rng.integers(0, SHAPE[1], 60)
    np.testing.assert_array_equal(LISTED.at(values, row, column), whole[row, column])


class _Counting(np.ndarray):
    """Counts the values that are taken from it."""

    taken = 0

    def __getitem__(self, index):
        found = super().__getitem__(index)
        type(self).taken += np.size(found)
        return found


def test_a_small_window_of_a_long_slope_looks_at_its_own_cells_only():
    """So that a slope's many zones take no more time each where the slope is longer."""
    layout = Layout((9, 50_000), np.arange(0, 9 * 50_000, 2))
    values = np.arange(layout.listed.size, dtype=float).view(_Counting)
    window = (slice(2, 6), slice(40_000, 40_010))
    assert np.array_equal(np.isfinite(layout.window(values, window)), np.tile([True, False], (4, 5)))
    assert _Counting.taken == 20


@pytest.mark.parametrize("side", [1, 3, 4, 30])
def test_sums_over_blocks_are_those_of_the_grid(side):
    expected = [
        [NUMBERS[i : i + side, j : j + side].sum() for j in range(0, SHAPE[1], side)] for i in range(0, SHAPE[0], side)
    ]
    assert LISTED.block_sums(LISTED.of(NUMBERS), side).tolist() == expected
    assert layout_of(NUMBERS).block_sums(NUMBERS, side).tolist() == expected


def test_places_lie_where_their_cells_are():
    place = np.arange(int(HELD.sum()))
    assert np.array_equal(np.column_stack(LISTED.row_and_column(place)), np.argwhere(HELD))
    every = np.arange(HELD.size)
    assert np.array_equal(Layout(SHAPE).flat(every), every)


def test_nothing_listed():
    none = Layout(SHAPE, np.zeros(0, dtype=np.int64))
    assert np.isnan(none.at(np.zeros(0), np.array([1]), np.array([2]))).all()
    assert np.isnan(none.on_grid(np.zeros(0))).all()


def test_bands_follow_each_other_without_a_gap():
    found = bands((1000, 300), 40_000)
    assert [b.start for b in found[1:]] == [b.stop for b in found[:-1]]
    assert (found[0].start, found[-1].stop) == (0, 1000)
    assert max(b.stop - b.start for b in found) * 300 <= 40_000
