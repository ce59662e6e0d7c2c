"""Stable ground where cells grew, with a change that was put in."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.change.judgement import judge
from slopewatch.engine.change.measured import Measured
from slopewatch.engine.change.size_calibration import widening_by_size
from slopewatch.engine.change.stable_cells import find_stable
from slopewatch.engine.grid.partition import Partition
from slopewatch.interface.parameters import ChangeParameters

RNG = np.random.default_rng(11)
SHAPE = (320, 320)  # 32 x 32 m in cells of 0.1 m


def blocks() -> np.ndarray:
    """Squares of 1.6 m; those of the southern third are cut into squares of 0.4 m."""
    coarse = np.arange(400).reshape(20, 20).repeat(16, axis=0).repeat(16, axis=1)
    fine = 1000 + np.arange(6400).reshape(80, 80).repeat(4, axis=0).repeat(4, axis=1)
    return np.where(np.arange(320)[:, None] < 208, coarse, fine)


BLOCK = blocks()
PARTITION = Partition.of_blocks(BLOCK, 0.1)
ERROR = np.full(SHAPE, 0.02)
NOISE = RNG.normal(0, 0.02, BLOCK.max() + 1)[BLOCK]
FLAT = np.full(SHAPE, 30.0)
MOVED = np.zeros(SHAPE, dtype=bool)
MOVED[32:96, 48:128] = True  # 20 coarse blocks
MOVED[240:280, 160:240] = True  # 200 fine ones


def test_a_change_in_large_blocks_is_not_taken_for_stable():
    stable = find_stable(np.where(MOVED, NOISE - 0.15, NOISE), ERROR, FLAT, PARTITION)
    assert stable[MOVED].mean() < 0.02
    assert stable[~MOVED].mean() > 0.75
    sums = np.bincount(BLOCK.ravel(), stable.ravel()) / np.bincount(BLOCK.ravel()).clip(1)
    assert set(np.unique(sums).tolist()) <= {0.0, 1.0}, "a block is stable as a whole or not at all"


def test_noise_in_blocks_is_stable():
    assert find_stable(NOISE, ERROR, FLAT, PARTITION).mean() > 0.95


def test_errors_of_blocks_are_calibrated_on_the_ground_that_did_not_move():
    """Stated too small by half, with a fifth of the slope changed: the factor is 2, and chance alone exceeds 5 %."""
    dz = np.where(MOVED, NOISE - 0.15, NOISE)
    found = judge(Measured(dz, ERROR / 2, FLAT, PARTITION), ChangeParameters(), registration_error=0.0)
    assert found.model.kind == "calibrated"
    assert np.median(found.sampling) == pytest.approx(2.0 * ERROR[0, 0] / 2, rel=0.1), "by size and by slope together"
    first = np.unique(BLOCK, return_index=True)[1]
    still = first[~MOVED.ravel()[first]]
    assert 0.03 < found.decision.significant.ravel()[still].mean() < 0.07
    assert found.decision.significant[MOVED].mean() > 0.95


def test_sizes_whose_errors_are_too_small_are_widened_by_themselves():
    """Coarse blocks err three times as much as they state, fine ones as much: both exceed as often as promised."""
    coarse = BLOCK < 1000
    measured = Measured(np.where(coarse, 3 * NOISE, NOISE), ERROR, FLAT, PARTITION)
    factor = widening_by_size(measured, first_cells() & ~MOVED, registration_error=0.0, confidence=0.95)
    assert set(np.unique(factor[coarse])) == {factor[0, 0]}
    assert factor[0, 0] == pytest.approx(3.0, rel=0.15)
    assert factor[-1, 0] == pytest.approx(1.0, abs=0.06)
    assert factor.min() >= 1.0
    found = judge(measured, ChangeParameters(), registration_error=0.0)
    for part in (coarse, ~coarse):
        assert 0.02 < found.decision.significant[first_cells() & part].mean() < 0.08
    few = np.zeros(SHAPE, dtype=bool)
    few[:64, :64] = True  # 16 coarse blocks tell nothing
    alone = widening_by_size(measured, first_cells() & few, registration_error=0.0, confidence=0.95)
    assert (alone == 1.0).all()


def first_cells() -> np.ndarray:
    first = np.zeros(BLOCK.size, dtype=bool)
    first[np.unique(BLOCK, return_index=True)[1]] = True
    return first.reshape(SHAPE)


def test_no_block_no_stable_ground():
    assert not find_stable(NOISE, ERROR, FLAT, Partition.of_blocks(np.full(SHAPE, -1), 0.1)).any()
