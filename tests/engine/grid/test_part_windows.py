"""Windows around parts, against loops over cells."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.change.thresholds import coherent_probability
from slopewatch.engine.grid.part_windows import PartWindows, sums_around
from slopewatch.engine.grid.partition import Partition

rng = np.random.default_rng(4)


def mixed() -> np.ndarray:
    """Blocks of 1, 2 and 4 cells' side beside each other, and a cell in none."""
    block = np.arange(144).reshape(12, 12)
    block[:, 4:8] = 200 + np.arange(12).reshape(6, 2).repeat(2, axis=0).repeat(2, axis=1)
    block[:, 8:] = 300 + np.arange(3)[:, None].repeat(4, axis=0)
    block[0, 0] = -1
    return block


def expected_sum(values: np.ndarray, block: np.ndarray, middle: tuple[int, int], half: int) -> float:
    total = 0.0
    row, column = middle
    for i in range(max(row - half, 0), min(row + half + 1, 12)):
        for j in range(max(column - half, 0), min(column + half + 1, 12)):
            if block[i, j] >= 0:
                total += values[i, j] / np.sum(block == block[i, j])
    return total


def test_parts_around_are_counted_in_a_window_of_their_own_size():
    """Part by part and cell by cell."""
    block = mixed()
    partition = Partition.of_blocks(block, 1.0)
    cells = rng.random(block.shape) < 0.6
    got = sums_around(partition, cells, 5)
    for row, column in np.argwhere(partition.middles(np.ones(block.shape, dtype=bool))):
        side = round(np.sqrt(np.sum(block == block[row, column])))
        expected = expected_sum(cells, block, (row, column), 5 * side // 2)
        assert np.allclose(got[block == block[row, column]], expected)
    assert got[0, 0] == 0


@pytest.mark.parametrize("values", [rng.random((12, 12)) < 0.6, rng.normal(size=(12, 12))], ids=["cells", "values"])
def test_where_nothing_has_grown_each_cell_counts_for_itself(values):
    got = sums_around(Partition((12, 12), 1.0), values, 5)
    for row, column in np.ndindex(12, 12):
        expected = values[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3].sum()
        assert got[row, column] == pytest.approx(expected)
    assert values.dtype != bool or (got == np.rint(got)).all()


@pytest.mark.parametrize("least", [1, 7])
def test_blocks_of_one_cell_are_cells(least):
    """Sums over chosen cells and what is near some are the same, however cells that did not grow are told."""
    here = np.flatnonzero(rng.random((12, 12)) < 0.7)
    block = np.full(144, -1)
    block[here] = np.arange(here.size)
    parts = Partition.of_blocks(block.reshape(12, 12), 1.0)
    z, chosen = rng.normal(size=here.size), rng.random(here.size) < 0.1
    least = max(least, 5)  # windows of blocks are three of their sides wide, of cells five
    one, other = (PartWindows(p, here, least) for p in (Partition((12, 12), 1.0), parts))
    for a, b in zip(one.totals(z, z**2), other.totals(z, z**2), strict=True):
        assert a == pytest.approx(b)
    assert np.array_equal(one.reached(chosen), other.reached(chosen))


def test_a_part_is_reached_as_a_whole():
    block = mixed()
    here = np.flatnonzero(block >= 0)
    windows = PartWindows(Partition.of_blocks(block, 1.0), here, 1)
    chosen = block.ravel()[here] == 205
    reached = np.zeros(144, dtype=bool)
    reached[here] = windows.reached(chosen)
    rows, columns = np.nonzero(block == 205)
    near = np.zeros(block.shape, dtype=bool)
    near[max(rows.min() - 2, 0) : rows.max() + 3, max(columns.min() - 2, 0) : columns.max() + 3] = True
    expected = np.isin(block, block[near])
    expected[0, 0] = False
    assert np.array_equal(reached.reshape(block.shape), expected)


def test_a_block_is_no_witness_for_itself():
    """Noise in blocks is alike within each; the coherent threshold must not take that for a change."""
    noise = np.random.default_rng(1).normal(0, 0.02, (30, 30))
    block = np.arange(900).reshape(30, 30).repeat(8, axis=0).repeat(8, axis=1)
    dz = noise.repeat(8, axis=0).repeat(8, axis=1)
    partition = Partition.of_blocks(block, 1.0)
    blind = coherent_probability(dz, np.full(dz.shape, 0.02), Partition(dz.shape, 1.0))
    knowing = coherent_probability(dz, np.full(dz.shape, 0.02), partition)
    assert np.mean(blind > 0.95) > 0.3
    assert np.mean(knowing > 0.95) < 0.02
    # as many as of cells of that size
    alone = coherent_probability(noise, np.full(noise.shape, 0.02), Partition(noise.shape, 1.0))
    assert np.mean(knowing > 0.95) == pytest.approx(np.mean(alone > 0.95), abs=0.005)
    moved = np.where(np.arange(240) < 120, dz - 0.06, dz)
    assert np.mean(coherent_probability(moved, np.full(dz.shape, 0.02), partition)[:, :96] > 0.95) > 0.95
