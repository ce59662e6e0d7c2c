"""Compiled sums over windows: numpy's to the last bit, and those of a look at every cell."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from slopewatch.engine.core import compiled
from slopewatch.engine.statistics import window_sums
from slopewatch.engine.statistics.window_sums import Windows
from slopewatch.tests.builders.kernels import assert_equal_ways


@pytest.fixture
def numba_at_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels are taken for any amount of work."""
    event = threading.Event()
    event.set()
    monkeypatch.setattr(compiled, "_AT_WORK", event)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0, 1, 2, 3, 5, 9])
@pytest.mark.parametrize("lines", [1, 7, 100])
def test_sums_are_those_of_numpy_and_of_every_cell(radius, lines, monkeypatch):
    shape = (31, 45)
    monkeypatch.setattr(window_sums, "_BAND", lines * shape[1])
    rng = np.random.default_rng(radius)
    cell, wanted = (np.flatnonzero(rng.random(shape) < share) for share in (0.4, 0.3))
    values = rng.normal(0, 1, (2, cell.size)) * [[1e6], [1.0]]
    found = assert_equal_ways(window_sums._window_sums, wanted, cell, values, shape, radius, lines)
    grid = np.zeros(shape)
    grid.ravel()[cell] = values[1]
    for k in range(0, wanted.size, 17):
        i, j = divmod(int(wanted[k]), shape[1])
        near = grid[max(i - radius, 0) : i + radius + 1, max(j - radius, 0) : j + radius + 1]
        assert found[1, k] == pytest.approx(near.sum(), abs=1e-12)


def test_no_cell_is_known_or_wanted():
    none = np.zeros(0, dtype=np.int64)
    some = np.arange(5)
    assert assert_equal_ways(window_sums._window_sums, none, some, np.ones((1, 5)), (3, 4), 1, 4).shape == (1, 0)
    assert assert_equal_ways(window_sums._window_sums, some, none, np.ones((1, 0)), (3, 4), 1, 4).tolist() == [
        [0.0] * 5
    ]


def test_windows_give_the_same_with_compiled_loops(numba_at_work):
    """Of fields of floats and whole numbers; 64 bits do not fit into a float and are left to numpy."""
    rng = np.random.default_rng(2)
    shape = (40, 30)
    cell, wanted = (np.flatnonzero(rng.random(shape) < 0.5) for _ in range(2))
    windows = Windows(wanted, shape, 3)
    fields = rng.normal(size=cell.size), rng.integers(0, 90, cell.size, dtype=np.int32)
    for compiled_sums, plain in zip(windows.totals(cell, *fields), windows.totals_by_numpy(cell, *fields), strict=True):
        assert compiled_sums.dtype == plain.dtype
        assert np.array_equal(compiled_sums, plain)
    large = np.full(cell.size, 2**60 + 1)
    assert np.array_equal(windows.totals(cell, large)[0], windows.totals_by_numpy(cell, large)[0])


@pytest.mark.parametrize("few", [1, 12])
def test_a_few_marked_cells_reach_what_a_look_at_each_window_finds(few):
    rng = np.random.default_rng(few)
    shape = (50, 64)
    wanted, cell = np.flatnonzero(rng.random(shape) < 0.6), np.sort(rng.choice(50 * 64, few, replace=False))
    cell[0] = 0  # the corner
    windows = Windows(wanted, shape, 4)
    assert cell.size * windows.size < wanted.size
    row, column = np.divmod(wanted, 64)
    near = [(abs(row - i) <= 4) & (abs(column - j) <= 4) for i, j in zip(*np.divmod(cell, 64), strict=True)]
    assert np.array_equal(windows.any(cell), np.any(near, axis=0))
