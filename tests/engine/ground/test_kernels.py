"""Compiled loops of the ground's refinement give numpy's bits; cells' lowest points are those of a plain loop."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.ground.densification import SUPPORT_DEPTH_M, SUPPORT_SHARE, lowest_supported
from slopewatch.engine.ground.lowest_layer import BIN_M, BINS, LOWEST_M, counts_around, histograms, layer_rows
from slopewatch.engine.ground.outliers import _STRIDES, _boxes
from slopewatch.engine.ground.stray_low import pooled_counts

from tests.builders.kernels import assert_equal_ways

ROWS, COLUMNS = 7, 9


@pytest.fixture
def counts() -> np.ndarray:
    """(ROWS, COLUMNS, BINS) bare ground, plants, few returns and none; quarters, as of windows with those around."""
    rng = np.random.default_rng(11)
    window = rng.integers(0, ROWS * COLUMNS - 4, 9000)
    height = np.where(window % 3 > 0, rng.normal(0, 0.02, 9000), rng.gamma(2, 0.1, 9000))
    few = (window % 7 != 3) | (rng.random(9000) < 0.02)
    found = histograms(height[few], window[few], ROWS * COLUMNS).reshape(ROWS, COLUMNS, BINS)
    return np.round(found * rng.random(found.shape) * 4) / 4


@pytest.mark.parametrize(
    "asked", [(0.016, 13, 0.06, 0.0025, 0.004), (0.03, 24, 0.1, 0.012, 0.01), (0.005, 4, 0.3, 0.012, 0.004)]
)
def test_layers_of_windows(counts, asked):
    ground, top, *_ = assert_equal_ways(layer_rows, counts.reshape(-1, BINS), *asked)
    known = np.isfinite(ground)
    assert 5 < np.count_nonzero(known) < ROWS * COLUMNS
    assert (top[known] > ground[known]).any()


def test_the_layer_of_ground_at_one_height_is_there():
    counts = np.zeros((1, BINS))
    at = round((0.05 - LOWEST_M) / BIN_M)
    counts[0, at - 4 : at + 4] = 30.0
    ground, top, taken, returns, _ = assert_equal_ways(layer_rows, counts, 0.01, 8, 0.06, BIN_M / 2, 0.004)
    assert ground[0] == pytest.approx(0.05, abs=BIN_M)
    assert (taken[0], returns[0]) == (240.0, 240.0)
    assert top[0] > 0.05 + 3 * BIN_M


def test_counts_of_windows_around(counts):
    row, column = (part[::3] for part in np.nonzero(counts.sum(axis=2) > 20))
    found = assert_equal_ways(counts_around, counts, row, column, 2)
    for k, (i, j) in enumerate(zip(row, column, strict=True)):
        inside = counts[max(i - 2, 0) : i + 3, max(j - 2, 0) : j + 3]
        assert np.array_equal(found[k], inside.sum(axis=(0, 1)))


def test_counts_of_voxels_around():
    rng = np.random.default_rng(12)
    width, levels = 12, 6
    grid = np.zeros((14, width, levels), dtype=np.int64)
    np.add.at(grid, tuple(rng.integers(2, high, 300) for high in (12, width - 2)) + (rng.integers(0, 4, 300),), 1)
    key = np.flatnonzero(grid)
    found = assert_equal_ways(pooled_counts, key, grid.ravel()[key], width, levels)
    for k, (i, j, level) in enumerate(np.argwhere(grid)):
        assert found[k] == grid[i - 2 : i + 3, j - 2 : j + 3, level : level + 2].sum()


@pytest.mark.parametrize("side", [1.0, 0.25])
def test_the_lowest_supported_point_of_a_cell_is_that_of_a_plain_loop(side):
    """Dense cells with strays below the ground, sparse ones, and several points of one height."""
    rng = np.random.default_rng(13)
    xyz = np.column_stack([rng.uniform(0, 3, (2500, 2)), np.round(np.abs(rng.normal(0, 0.2, 2500)), 2)])
    stray = rng.random(2500) < 0.01
    xyz[stray, 2] = -np.round(rng.uniform(0.5, 2, stray.sum()), 2)
    cell = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / side)
    expected = []
    for place in np.unique(cell, axis=0):
        inside = np.flatnonzero((cell == place).all(axis=1))
        z = xyz[inside, 2]
        above = np.array([np.count_nonzero((z >= low) & (z <= low + SUPPORT_DEPTH_M + 1e-9)) for low in z])
        sure = inside[above >= max(1.0, SUPPORT_SHARE * len(inside))]
        lowest = sure[xyz[sure, 2] == xyz[sure, 2].min()]
        expected.append(lowest[np.lexsort((xyz[lowest, 1], xyz[lowest, 0]))[0]])
    found = lowest_supported(xyz, side)
    assert np.array_equal(found, expected)
    assert (xyz[found, 2] < -0.4).any() == (side < 1.0)  # a stray is believed only where returns are few


@pytest.mark.parametrize("reach", [4, 100_000])
def test_boxes_are_numbered_as_by_a_sort(reach):
    places = np.random.default_rng(14).integers(-reach, reach, (300, 3)) + (1 << 20)
    key = places @ _STRIDES
    for found, expected in zip(_boxes(key), np.unique(key, return_inverse=True, return_counts=True), strict=True):
        assert np.array_equal(found, expected)
