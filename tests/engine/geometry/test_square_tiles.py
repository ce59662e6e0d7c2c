"""Work in tiles is work on the whole, as far as the margin reaches."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.square_tiles import in_tiles


def neighbours(points: np.ndarray) -> np.ndarray:
    """How many points lie within 1 m of each, and its own x."""
    apart = np.hypot(*(points[:, None, :2] - points[None, :, :2]).transpose(2, 0, 1))
    return np.column_stack([(apart < 1.0).sum(axis=1), points[:, 0]])


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(0).uniform(0, [35, 20, 1], (1500, 3))


def test_tiles_give_each_point_what_the_whole_gives(points):
    assert np.array_equal(in_tiles(points, neighbours, 7.0, 2.0, 0.5), neighbours(points))


def test_without_a_margin_neighbours_are_missing(points):
    assert (in_tiles(points, neighbours, 7.0, 0.0, 0.5)[:, 0] < neighbours(points)[:, 0]).any()


def test_a_small_cloud_is_one_tile_and_a_large_one_several(points):
    sizes = []

    def work(part: np.ndarray) -> np.ndarray:
        sizes.append(len(part))
        return part[:, 0]

    in_tiles(points, work, 24.0, 2.0, 0.5)
    assert sizes == [1500]
    in_tiles(points, work, 10.0, 2.0, 0.5)
    assert len(sizes) == 1 + 4 * 2
    assert max(sizes[1:]) < 1500


def test_points_on_the_edges_of_tiles_are_done_once():
    x, y = np.meshgrid(np.arange(0, 41, 5.0), np.arange(0, 41, 5.0))
    corners = np.column_stack([x.ravel(), y.ravel()])
    assert np.array_equal(in_tiles(corners, lambda part: part, 10.0, 1.0, 0.5), corners)


def test_tiles_begin_at_multiples_of_the_step(points):
    """Cells of the step laid out from any tile's corner fall together with those of the whole."""
    low = points[:, :2].min(axis=0)
    calls = iter(range(100))
    tile = in_tiles(points, lambda part: np.full(len(part), next(calls)), 10.1, 1.0, 0.7)
    # a side of 10.1 is 14 steps of 0.7
    square = np.floor((points[:, :2] - low) / 0.7) // 14
    found = np.unique(np.column_stack([square, tile]), axis=0)
    assert len(found) == len(np.unique(square, axis=0)) == next(calls) == 4 * 3
