"""Numbers counted, and the lowest point of each, against numpy's sorting ways."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.columns import greatest, largest_sizes, least, spans
from slopewatch.engine.geometry.numbered import counts_of_each, distinct, lowest_of_each, united


@pytest.mark.parametrize("step", [1, 40_000_000], ids=["close", "far apart"])
def test_distinct_numbers_are_those_of_a_sort(step):
    numbers = np.random.default_rng(1).integers(-50, 60, 400) * step
    for found, expected in zip(
        distinct(numbers), np.unique(numbers, return_inverse=True, return_counts=True), strict=True
    ):
        assert np.array_equal(found, expected)
    assert np.array_equal(counts_of_each(numbers), np.unique(numbers, return_counts=True)[1])


@pytest.mark.parametrize("step", [1, 40_000_000], ids=["close", "far apart"])
def test_united_numbers_are_those_of_a_sort(step):
    rng = np.random.default_rng(4)
    parts = [rng.integers(-50, 60, count) * step for count in (30, 0, 70)]
    found = united(*parts)
    assert np.array_equal(found, np.unique(np.concatenate(parts)))
    assert found.dtype == np.int64


def test_no_numbers_are_none():
    assert len(united(np.zeros(0, dtype=np.int64))) == 0
    assert [len(part) for part in distinct(np.zeros(0, dtype=np.int64))] == [0, 0, 0]


@pytest.mark.parametrize("step", [1, 40_000_000], ids=["close", "far apart"])
def test_the_lowest_of_each_is_the_first_of_a_stable_sort(step):
    rng = np.random.default_rng(2)
    numbers, height = rng.integers(0, 30, 500) * step, rng.integers(-3, 4, 500) / 2.0  # many of one height
    order = np.lexsort((height, numbers))
    first = np.unique(numbers[order], return_index=True)[1]
    assert np.array_equal(lowest_of_each(numbers, height), order[first])


def test_extremes_by_column_are_those_along_the_first_axis():
    points = np.random.default_rng(3).normal(size=(200, 3))
    for array in (points, points[:, :2], np.floor(points * 9).astype(np.int64)):
        assert np.array_equal(least(array), array.min(axis=0))
        assert np.array_equal(greatest(array), array.max(axis=0))
        assert np.array_equal(spans(array), np.ptp(array, axis=0))
        assert np.array_equal(largest_sizes(array), np.abs(array).max(axis=1))
    assert np.isnan(least(np.array([[1.0, np.nan], [2.0, 3.0]]))).tolist() == [False, True]
