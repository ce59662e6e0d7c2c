"""Sums over windows against sums over slices."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from slopewatch.engine.statistics import window_sums
from slopewatch.engine.statistics.window_sums import Windows, slide

SHAPE = (23, 17)


def slices(cell: np.ndarray, radius: int) -> Iterator[tuple[slice, slice]]:
    for i, j in zip(*np.unravel_index(cell, SHAPE), strict=True):
        yield np.s_[max(i - radius, 0) : i + radius + 1, max(j - radius, 0) : j + radius + 1]


@pytest.mark.parametrize("size", [1, 2, 3, 6, 7, 11, 21])
@pytest.mark.parametrize("step", [1, 4])
def test_slide_joins_the_cells_after_each(size, step):
    cells = np.random.default_rng(1).integers(-9, 9, 100)
    for join in (np.add, np.maximum):
        expected = [join.reduce(cells[k : k + size * step : step]) for k in range(100 - (size - 1) * step)]
        assert slide(cells, size, step, join).tolist() == expected


@pytest.mark.parametrize("band", [1, 10**6])
@pytest.mark.parametrize("radius", [0, 2, 5, 30])
def test_totals_equal_sums_over_slices(monkeypatch, band, radius):
    """Of values at some cells, around others, in one part and in many."""
    monkeypatch.setattr(window_sums, "_BAND", band)
    rng = np.random.default_rng(radius)
    known, wanted = (np.flatnonzero(rng.random(SHAPE) < share) for share in (0.5, 0.3))
    fields = rng.normal(size=known.size), rng.integers(-9, 9, known.size)
    totals = Windows(wanted, SHAPE, radius).totals(known, *fields)
    for total, field in zip(totals, fields, strict=True):
        grid = np.zeros(SHAPE, dtype=field.dtype)
        grid.ravel()[known] = field
        assert total == pytest.approx([grid[near].sum() for near in slices(wanted, radius)], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("radius", [0, 1, 4])
def test_any_tells_whether_a_cell_is_in_the_window(radius):
    rng = np.random.default_rng(3)
    marked = rng.random(SHAPE) < 0.03
    everywhere = np.arange(marked.size)
    found = Windows(everywhere, SHAPE, radius).any(np.flatnonzero(marked))
    assert found.tolist() == [marked[near].any() for near in slices(everywhere, radius)]


def test_a_large_value_far_off_costs_the_sum_no_digit():
    values = np.full(400, 0.1)
    values[0] = 1e15
    (total,) = Windows(np.array([210]), (20, 20), 2).totals(np.arange(400), values)
    assert total[0] == pytest.approx(2.5, rel=1e-14)


def test_whole_numbers_that_overflow_on_the_way_still_give_the_sum():
    values = np.resize(np.array([30_000, -30_000], dtype=np.int16), 81)
    (total,) = Windows(np.array([40]), (9, 9), 4).totals(np.arange(81), values)
    assert total.tolist() == [30_000]


@settings(max_examples=40, deadline=None)
@given(st.data(), st.tuples(st.integers(1, 9), st.integers(1, 9)), st.integers(0, 10), st.sampled_from([1, 20, 10**6]))
def test_windows_of_any_grid_equal_a_look_at_every_cell(data, shape, radius, band):
    """Of grids of a line, windows larger than the grid, no cell at all, and parts of any height."""
    known, wanted = (np.flatnonzero(data.draw(arrays(bool, shape))) for _ in range(2))
    values = data.draw(arrays(np.int64, known.size, elements=st.integers(-(2**40), 2**40)))
    windows = Windows(wanted, shape, radius)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(window_sums, "_BAND", band)
        (total,) = windows.totals(known, values)
    row, column = np.unravel_index(known, shape)
    for cell, sum_here, any_here in zip(wanted, total, windows.any(known), strict=True):
        i, j = np.unravel_index(cell, shape)
        near = (np.abs(row - i) <= radius) & (np.abs(column - j) <= radius)
        assert sum_here == values[near].sum()
        assert any_here == near.any()
