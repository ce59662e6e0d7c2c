"""Blocks of cells that count once, against loops over blocks."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.change.thresholds import coherent_probability
from slopewatch.engine.grid.blocks import blocks_in_groups, middle_cells, sums_around

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


def test_blocks_in_groups_are_counted_once_in_each():
    labels = rng.integers(0, 4, BLOCK.shape)
    got = blocks_in_groups(labels, BLOCK, 4)
    for label in range(1, 5):
        inside = BLOCK[labels == label]
        assert got[label] == len(set(inside[inside >= 0])) + np.sum(inside < 0)


def test_no_block_at_all():
    nothing = np.full((3, 3), -1)
    assert not middle_cells(nothing).any()
    assert blocks_in_groups(np.eye(3, dtype=int), nothing, 1).tolist() == [0, 3]


def test_blocks_around_are_counted_in_a_window_of_their_own_size():
    """Blocks of 1, 2 and 4 cells' side beside each other, block by block and cell by cell."""
    block = np.arange(144).reshape(12, 12)
    block[:, 4:8] = 200 + np.arange(12).reshape(6, 2).repeat(2, axis=0).repeat(2, axis=1)
    block[:, 8:] = 300 + np.arange(3)[:, None].repeat(4, axis=0)
    block[0, 0] = -1
    cells = rng.random(block.shape) < 0.6
    got = sums_around(cells, block, 5)
    middle = np.argwhere(middle_cells(block))
    for row, column in middle:
        own = np.argwhere(block == block[row, column])
        side = round(np.sqrt(len(own)))
        half = 5 * side // 2
        expected = 0.0
        for i in range(max(row - half, 0), min(row + half + 1, 12)):
            for j in range(max(column - half, 0), min(column + half + 1, 12)):
                if block[i, j] >= 0 and cells[i, j]:
                    expected += 1 / np.sum(block == block[i, j])
        assert np.allclose(got[block == block[row, column]], expected)
    assert got[0, 0] == 0


def test_a_block_is_no_witness_for_itself():
    """Noise in blocks is alike within each; the coherent threshold must not take that for a change."""
    noise = np.random.default_rng(1).normal(0, 0.02, (30, 30))
    block = np.arange(900).reshape(30, 30).repeat(8, axis=0).repeat(8, axis=1)
    dz = noise.repeat(8, axis=0).repeat(8, axis=1)
    blind = coherent_probability(dz, np.full(dz.shape, 0.02))
    knowing = coherent_probability(dz, np.full(dz.shape, 0.02), block)
    assert np.mean(blind > 0.95) > 0.3
    assert np.mean(knowing > 0.95) < 0.02
    # as many as of cells of that size
    alone = coherent_probability(noise, np.full(noise.shape, 0.02))
    assert np.mean(knowing > 0.95) == pytest.approx(np.mean(alone > 0.95), abs=0.005)
    moved = np.where(np.arange(240) < 120, dz - 0.06, dz)
    assert np.mean(coherent_probability(moved, np.full(dz.shape, 0.02), block)[:, :96] > 0.95) > 0.95
