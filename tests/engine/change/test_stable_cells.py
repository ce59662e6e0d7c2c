"""Stable ground against known change."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from slopewatch.engine.change.stable_cells import changed_cells, find_stable
from slopewatch.tests.builders.change_zones import single

SHAPE, CELL = (160, 200), 0.25


def scene(seed: int, *, correlated: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Noise that grows with the slope beyond what its error says, gaps as under plants, and the slope."""
    rng = np.random.default_rng(seed)
    slope = np.broadcast_to(np.linspace(0, 60, SHAPE[1]), SHAPE).copy()
    error = rng.uniform(0.008, 0.015, SHAPE)
    dz = rng.normal(0, 1, SHAPE) * error * (1 + slope / 60)
    if correlated:
        wave = ndimage.gaussian_filter(rng.normal(0, 1, SHAPE), 6)
        dz += correlated * wave / wave.std()
    dz[rng.random(SHAPE) < 0.3] = np.nan
    return dz, error, slope


def moved(share: float) -> np.ndarray:
    """Discs over a share of the grid."""
    row, column = np.indices(SHAPE)
    cells = np.zeros(SHAPE, dtype=bool)
    rng = np.random.default_rng(1)
    while cells.mean() < share:
        y, x, radius = rng.uniform(0, SHAPE[0]), rng.uniform(0, SHAPE[1]), rng.uniform(8, 30)
        cells |= np.hypot(row - y, column - x) < radius
    return cells


@pytest.mark.parametrize("correlated", [0.0, 0.006])
def test_unchanged_ground_stays(correlated):
    dz, error, slope = scene(2, correlated=correlated)
    stable = find_stable(dz, error, slope, single(dz, CELL))
    assert stable.sum() > 0.95 * np.isfinite(dz).sum()
    assert not stable[np.isnan(dz)].any()


@pytest.mark.parametrize("amount", [-0.04, 0.1, 0.5])
def test_change_of_thirty_percent_is_left_out(amount):
    dz, error, slope = scene(3)
    cells = moved(0.3)
    stable = find_stable(dz + np.where(cells, amount, 0.0), error, slope, single(dz, CELL))
    known = np.isfinite(dz)
    assert stable[cells & known].mean() < 0.02
    assert stable[~cells & known].mean() > 0.6  # the surroundings of discs go, too


def test_a_whole_class_of_slope_may_have_moved():
    dz, error, slope = scene(4)
    steep = slope > 45
    stable = find_stable(dz + np.where(steep, 0.15, 0.0), error, slope, single(dz, CELL))
    assert stable[steep & np.isfinite(dz)].mean() < 0.02


def test_single_wild_cells_are_no_moved_place():
    dz, error, slope = scene(5)
    wild = np.random.default_rng(6).random(SHAPE) < 0.01
    stable = find_stable(np.where(wild, 3.0, dz), error, slope, single(dz, CELL))
    assert stable.sum() > 0.95 * np.isfinite(np.where(wild, 3.0, dz)).sum()


def test_nothing_compared_is_nothing_stable():
    nothing = np.full((4, 5), np.nan)
    assert not find_stable(nothing, nothing, nothing, single(nothing, CELL)).any()


def test_what_has_changed_as_a_whole_is_told_from_noise_and_from_single_cells():
    random = np.random.default_rng(2)
    error = np.full((60, 60), 0.02)
    dz = random.normal(0, 0.02, error.shape)
    assert not changed_cells(dz, error, 0.2).any()
    dz[5, 5] = 50.0
    assert not changed_cells(dz, error, 0.2).any(), "one wild cell"
    dz[20:40, 20:40] += 0.15
    found = changed_cells(dz, error, 0.2)
    assert found[23:37, 23:37].all()
    assert not found[:17].any()
    dz[30, 30] = np.nan
    assert not changed_cells(dz, error, 0.2)[30, 30]
