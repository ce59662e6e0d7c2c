"""Parts of a grid, against loops over cells and parts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from slopewatch.engine.grid.partition import Partition

CELL = 0.2
MOST = 6  # parts


@st.composite
def grids(draw: st.DrawFn) -> tuple[Partition, np.ndarray, np.ndarray, np.ndarray]:
    """A partition, some of its cells, their values, and labels from 0 to 3; parts without cells and cells without a
    part are among them, and partitions in which nothing has grown.
    """
    shape = draw(st.tuples(st.integers(1, 5), st.integers(1, 5)))
    chosen = draw(arrays(bool, shape))
    values = draw(arrays(np.float64, shape, elements=st.integers(-9, 9).map(float)))
    labels = draw(arrays(np.int32, shape, elements=st.integers(0, 3)))
    if draw(st.booleans()):
        return Partition(shape, CELL), chosen, values, labels
    block = draw(arrays(np.int32, shape, elements=st.integers(-1, MOST - 1)))
    return Partition.of_blocks(block, CELL, np.arange(1.0, MOST + 1)), chosen, values, labels


def cells_of(partition: Partition) -> dict[int, list[int]]:
    """Flat indices of the cells of each part, in the grid's order; cell by cell."""
    found: dict[int, list[int]] = {}
    for cell, number in enumerate(partition.number.ravel().tolist()):
        if number >= 0:
            found.setdefault(number, []).append(cell)
    return found


def true_at(partition: Partition, cells: set[int]) -> np.ndarray:
    return np.isin(np.arange(partition.number.size), sorted(cells)).reshape(partition.shape)


@given(grids())
@settings(max_examples=80, deadline=None)
def test_what_is_said_of_parts_is_what_counting_their_cells_gives(drawn) -> None:
    partition, chosen, values, labels = drawn
    of = cells_of(partition)
    picked = set(np.flatnonzero(chosen).tolist())
    assert partition.cells.tolist() == [len(of.get(n, [])) for n in range(partition.count)]
    for number, width in enumerate(partition.width.tolist()):
        cells = max(len(of.get(number, [])), 1)
        assert width**2 >= cells
        assert width == 1 or (width / 2) ** 2 < cells
    inside = {cell for cells in of.values() for cell in cells}
    assert np.array_equal(partition.within(chosen), true_at(partition, picked & inside))
    first = {cells[0] for cells in of.values()}
    assert np.array_equal(partition.one_each(chosen), true_at(partition, picked & first))
    assert partition.parts_among(chosen) == sum(bool(picked & set(cells)) for cells in of.values())
    in_groups = [sum(any(labels.ravel()[c] == g for c in cells) for cells in of.values()) for g in (1, 2, 3)]
    assert partition.parts_in_groups(labels, 3).tolist() == in_groups
    expected = values.ravel().copy()
    for cells in of.values():
        here = [c for c in cells if c in picked] if partition.grown else []
        if here:
            total = sum(values.ravel()[here].tolist())
            expected[here] = 0.0
            expected[here[0]] = total
    assert np.array_equal(partition.gathered(values, chosen), expected.reshape(partition.shape))


@given(grids())
@settings(max_examples=50, deadline=None)
def test_values_of_parts_go_to_their_cells(drawn) -> None:
    partition = drawn[0]
    of_parts = np.arange(partition.count) * 1.5
    on_cells = partition.of_cells(of_parts)
    sizes = partition.sizes
    for number, cells in cells_of(partition).items():
        assert (on_cells.ravel()[cells] == of_parts[number]).all()
        assert (sizes.ravel()[cells] == (number + 1.0 if partition.grown else CELL)).all()
    without = partition.number < 0
    assert np.isnan(on_cells[without]).all()
    assert np.isnan(sizes[without]).all()
    assert (partition.of_cells(of_parts, empty=-7.0)[without] == -7.0).all()


@given(grids())
@settings(max_examples=50, deadline=None)
def test_cells_and_pairs_of_cells_among_some(drawn) -> None:
    partition, chosen, _, _ = drawn
    here = np.flatnonzero(partition.within(chosen))
    number = partition.number.ravel()[here].tolist()
    lead = np.ones(here.size, dtype=bool)[partition.first_among(here)]
    if partition.grown:
        lead = partition.first_among(here)
        assert lead.tolist() == [n not in number[:k] for k, n in enumerate(number)]
    else:
        assert lead.all()
    one, other = (place.ravel() for place in np.indices((here.size, here.size)))
    if not partition.grown:
        one, other = one[one != other], other[one != other]
    kept = partition.apart(here, one, other)
    pairs = [(a, b) for a, b in zip(one.tolist(), other.tolist(), strict=True) if number[a] != number[b]]
    assert list(zip(one[kept].tolist(), other[kept].tolist(), strict=True)) == pairs


@given(grids(), st.data())
@settings(max_examples=40, deadline=None)
def test_a_window_is_cut_out_of_the_whole(drawn, data) -> None:
    partition = drawn[0]
    window = tuple(slice(first, data.draw(st.integers(first, size + 3))) for first, size in zip(
        (data.draw(st.integers(0, size - 1)) for size in partition.shape), partition.shape, strict=True
    ))  # fmt: skip
    part = partition.window(window)
    assert part.shape == partition.number[window].shape
    assert np.array_equal(part.sizes, partition.sizes[window], equal_nan=True)
    if partition.grown:
        assert part.count == partition.count
        assert np.array_equal(part.number, partition.number[window])
        assert part.cells.tolist() == [np.sum(partition.number[window] == n) for n in range(part.count)]


@given(grids())
@settings(max_examples=50, deadline=None)
def test_the_middle_of_a_part_is_its_cell_nearest_to_the_mean_of_all(drawn) -> None:
    partition, chosen, _, _ = drawn
    of = cells_of(partition)
    for number, cells in of.items():
        places = np.column_stack(np.divmod(cells, partition.shape[1])).astype(float)
        away = np.hypot(*(places - places.mean(axis=0)).T)
        assert partition.middle[number] == cells[int(np.argmax(away <= away.min() + 1e-6))]
    assert (partition.middle[partition.cells == 0] == -1).all()
    picked = set(np.flatnonzero(chosen).tolist())
    middles = {int(partition.middle[number]) for number in of}
    assert np.array_equal(partition.middles(chosen), true_at(partition, picked & middles))


def test_sides_that_are_not_told_are_those_of_the_smallest_square() -> None:
    block = np.array([[0, 0, 1, 2], [0, 0, 1, 2], [3, 3, -1, 2], [3, 3, 3, 2]])
    assert Partition.of_blocks(block, CELL).side == pytest.approx([2 * CELL, 2 * CELL, 2 * CELL, 4 * CELL])


def test_without_growth_nothing_is_copied() -> None:
    """A dense grid must not pay for blocks that it has not."""
    shape = (300, 400)
    partition = Partition(shape, CELL)
    values, chosen = np.zeros(shape), np.ones(shape, dtype=bool)
    assert partition.within(chosen) is chosen
    assert partition.one_each(chosen) is chosen
    assert partition.middles(chosen) is chosen
    assert partition.gathered(values, chosen) is values
    assert np.shares_memory(partition.of_cells(values.ravel()), values)
    assert partition.sizes.strides == (0, 0)
    assert partition.cells.strides == partition.width.strides == (0,)
    assert partition.window((slice(3, 9), slice(5, 999))) == Partition((6, 395), CELL)


def test_no_part_at_all() -> None:
    nothing = Partition.of_blocks(np.full((3, 3), -1), CELL)
    everywhere = np.ones((3, 3), dtype=bool)
    assert nothing.count == nothing.parts_among(everywhere) == 0
    assert not nothing.one_each(everywhere).any()
    assert not nothing.middles(everywhere).any()
    assert not nothing.within(everywhere).any()
    assert np.isnan(nothing.sizes).all()
    assert nothing.parts_in_groups(np.eye(3, dtype=int), 1).tolist() == [0]
