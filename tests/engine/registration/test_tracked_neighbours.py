"""Neighbours that are kept from call to call against all distances computed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slopewatch.engine.registration.tracked_neighbours import TrackedNeighbours


class CountingTree:
    """A tree that tells how many points it was asked for."""

    def __init__(self, points: np.ndarray) -> None:
        self.tree, self.asked = cKDTree(points), 0
        self.n, self.data = self.tree.n, self.tree.data

    def query(self, places, **options):
        self.asked += len(places)
        return self.tree.query(places, **options)


def brute_force(points: np.ndarray, places: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    distances = np.linalg.norm(places[:, None] - points[None], axis=2)
    near, number = distances.min(axis=1), distances.argmin(axis=1)
    return np.where(near < reach, near, np.inf), np.where(near < reach, number, len(points))


@pytest.mark.parametrize("count", [400, 1])
def test_same_neighbours_as_all_distances_on_a_walk_with_changing_reach(count):
    rng = np.random.default_rng(0)
    points, places = rng.uniform(0, 1, (count, 3)), rng.uniform(-0.3, 1.3, (500, 3))
    tracked = TrackedNeighbours(cKDTree(points), len(places))
    beyond = 0
    for step, reach in enumerate((0.2, 0.05, 0.05, 0.3, 0.1, 0.1, 0.1, 0.5, 0.05, 0.2)):
        places = places + rng.normal(0, 0.02 / (1 + step % 4), places.shape)
        which = np.sort(rng.choice(len(places), 350, replace=False))
        near, number = tracked.nearest(which, places[which], reach)
        expected = brute_force(points, places[which], reach)
        assert np.array_equal(number, expected[1])
        assert np.allclose(near, expected[0], atol=1e-12)
        beyond += np.count_nonzero(np.isinf(near))
    assert 0 < beyond < 3500


def test_points_that_hardly_move_are_not_searched_again():
    rng = np.random.default_rng(0)
    tree = CountingTree(rng.uniform(0, 1, (2000, 3)))
    places = rng.uniform(-0.5, 1, (5000, 3))  # many have no neighbour, which is to be kept, too
    tracked = TrackedNeighbours(tree, len(places))
    every = np.arange(len(places))
    tracked.nearest(every, places, 0.05)
    assert tree.asked == len(places)
    tracked.nearest(every, places + [1e-4, 0.0, -1e-4], 0.05)
    assert tree.asked < 1.05 * len(places)


def test_points_that_go_back_and_forth_have_another_candidate_rather_than_a_search():
    rng = np.random.default_rng(0)
    tree = CountingTree(rng.uniform(0, 1, (2000, 3)))
    places = rng.uniform(0, 1, (3000, 3))
    tracked = TrackedNeighbours(tree, len(places))
    every = np.arange(len(places))
    tracked.nearest(every, places, 0.2)
    changed = 0
    for step in (0.01, -0.01, 0.01, -0.01):
        _, number = tracked.nearest(every, places + [step, 0.0, 0.0], 0.2)
        _, before = tree.tree.query(places)
        changed += np.count_nonzero(number != before)
        assert np.array_equal(number, tree.tree.query(places + [step, 0.0, 0.0])[1])
    assert changed > 300  # keeping the first one for as long as it is sure would search most points each time
    assert tree.asked < 1.5 * len(places)
