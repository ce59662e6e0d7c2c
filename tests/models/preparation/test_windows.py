"""Windows, samples and weights against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.models.preparation.windows import centre_weight, cover_fixed, sample_fixed, windows


@pytest.mark.parametrize("spread", [False, True])
def test_windows_hold_exactly_the_points_within_them_and_all_points_are_in_one(spread):
    xy = np.random.default_rng(1).uniform(0, 1, (3000, 2)) * (51, 33)
    found = windows(xy, 20.0, 18.0, spread=spread)
    for window in found:
        inside = (np.abs(xy - window.middle) <= 10.0).all(axis=1)
        np.testing.assert_array_equal(window.points, np.flatnonzero(inside))
    assert len(np.unique(np.concatenate([w.points for w in found]))) == 3000
    assert len(found) == 3 * 2
    lefts = sorted({round(w.middle[0], 9) for w in found})
    if spread:
        assert max(lefts) + 10 == pytest.approx(xy[:, 0].max())
        assert np.diff(lefts).max() <= 18.0
    else:
        np.testing.assert_allclose(np.diff(lefts), 18.0)
        assert min(lefts) - 10 == pytest.approx(xy[:, 0].min())


def test_sparse_windows_are_left_out():
    rng = np.random.default_rng(2)
    xy = np.concatenate([rng.uniform(0, 20, (5000, 2)), rng.uniform(0, 20, (50, 2)) + (36.5, 0)])
    assert [len(w.points) >= 4096 for w in windows(xy, 20.0, 18.0, 4096)] == [True]
    assert len(windows(xy, 20.0, 18.0, 100)) == 2


def test_fixed_samples_have_the_number_asked_for():
    rng = np.random.default_rng(3)
    points = np.arange(100, 400)
    fewer = sample_fixed(points, 50, rng)
    assert len(np.unique(fewer)) == 50
    more = sample_fixed(points, 1000, rng)
    assert len(more) == 1000
    np.testing.assert_array_equal(np.unique(more), points)


def test_covering_blocks_hold_every_point_and_are_full():
    points = np.arange(1000)
    blocks = list(cover_fixed(points, 300, np.random.default_rng(4)))
    assert [len(block) for block in blocks] == [300] * 4
    np.testing.assert_array_equal(np.unique(np.concatenate(blocks)), points)
    assert len(np.unique(blocks[-1])) == 300
    (only,) = cover_fixed(np.arange(7), 20, np.random.default_rng(5))
    assert len(only) == 20


def test_votes_count_most_in_the_middle():
    weight = centre_weight(np.array([[10.0, 10.0], [5.0, 10.0], [2.5, 10.0], [0.0, 10.0]]), (10.0, 10.0), 20.0)
    np.testing.assert_allclose(weight, [1.0, 1.0, 0.5, 0.05])
