"""Blocks of cells that count once, against loops over blocks."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.blocks import blocks_in_groups, gathered, middle_cells

rng = np.random.default_rng(4)
BLOCK = rng.integers(0, 9, (4, 5)).repeat(3, axis=0).repeat(3, axis=1)
BLOCK[rng.random(BLOCK.shape) < 0.2] = -1
BLOCK[BLOCK == 7] = 6  # a number that no block has


def test_middle_cells_are_one_a_block_and_near_its_middle():
    middle = middle_cells(BLOCK)
    assert sorted(BLOCK[middle]) == [n for n in np.unique(BLOCK) if n >= 0]
    for row, column in np.argwhere(middle):
        cells = np.argwhere(BLOCK[row, column] == BLOCK)
        distance = np.hypot(*(cells - cells.mean(axis=0)).T)
        assert np.hypot(*(np.array([row, column]) - cells.mean(axis=0))) == pytest.approx(distance.min())


def test_gathered_values_keep_their_sum_in_one_cell_a_block():
    values = rng.normal(size=BLOCK.shape)
    got = gathered(values, BLOCK)
    assert np.array_equal(got[BLOCK < 0], values[BLOCK < 0])
    assert np.count_nonzero(got[BLOCK >= 0]) == len(np.unique(BLOCK)) - 1
    for number in np.unique(BLOCK[BLOCK >= 0]):
        assert got[number == BLOCK].sum() == pytest.approx(values[number == BLOCK].sum())


def test_blocks_in_groups_are_counted_once_in_each():
    labels = rng.integers(0, 4, BLOCK.shape)
    got = blocks_in_groups(labels, BLOCK, 4)
    for label in range(1, 5):
        inside = BLOCK[labels == label]
        assert got[label] == len(set(inside[inside >= 0])) + np.sum(inside < 0)


def test_no_block_at_all():
    nothing = np.full((3, 3), -1)
    assert not middle_cells(nothing).any()
    assert np.array_equal(gathered(np.ones((3, 3)), nothing), np.ones((3, 3)))
    assert blocks_in_groups(np.eye(3, dtype=int), nothing, 1).tolist() == [0, 3]
