"""Triangles against brute force, the lowest points of cells against loops, and what becomes ground of candidates."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from slopewatch.engine.ground.densification import Triangles, densified, lowest_of_cells, lowest_supported
from slopewatch.tests.builders.ground_shapes import jittered_grid


def around(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles (m, 2) and squared radii (m,) of the circles through triangles' corners (m, 3, 2)."""
    a, b, c = corners.transpose(1, 0, 2)
    matrix = 2 * np.stack([b - a, c - a], axis=1)
    right = np.stack([(b**2 - a**2).sum(axis=1), (c**2 - a**2).sum(axis=1)], axis=1)
    middle = np.linalg.solve(matrix, right[..., None])[..., 0]
    return middle, ((middle - a) ** 2).sum(axis=1)


def triangle_at(points: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Corners (3, 3) of the Delaunay triangle at a place (2,): the one around it whose circle holds no other point."""
    corners = points[np.array(list(combinations(range(len(points)), 3)))]
    corners = corners[np.abs(np.linalg.det(corners[:, 1:, :2] - corners[:, :1, :2])) > 1e-9]
    edges = np.roll(corners[..., :2], -1, axis=1) - corners[..., :2]
    to = place - corners[..., :2]
    side = edges[..., 0] * to[..., 1] - edges[..., 1] * to[..., 0]
    corners = corners[(side > 0).all(axis=1) | (side < 0).all(axis=1)]
    middle, square = around(corners[..., :2])
    apart = ((points[None, :, :2] - middle[:, None]) ** 2).sum(axis=2)
    empty = (apart >= square[:, None] * (1 - 1e-9)).all(axis=1)
    assert empty.sum() == 1
    return corners[empty][0]


@pytest.fixture(scope="module")
def hills() -> np.ndarray:
    return np.random.default_rng(1).uniform([0, 0, -1], [10, 8, 1], (30, 3))


def test_heights_and_distances_are_those_of_the_triangle_with_an_empty_circle(hills):
    rng = np.random.default_rng(2)
    queries = np.column_stack([rng.uniform([3, 2], [7, 6], (25, 2)), rng.uniform(-2, 2, 25)])
    surface = Triangles(hills)
    heights = surface.height(queries[:, :2])
    distances, nearest = surface.seen(queries)
    for query, height, distance, away in zip(queries, heights, distances, nearest, strict=True):
        corners = triangle_at(hills, query[:2])
        share = np.linalg.solve(np.vstack([corners[:, :2].T, np.ones(3)]), [*query[:2], 1.0])
        assert height == pytest.approx(share @ corners[:, 2], abs=1e-9)
        # the plane z = p x + q y + r
        p, q, r = np.linalg.solve(np.column_stack([corners[:, :2], np.ones(3)]), corners[:, 2])
        expected = (query[2] - (p * query[0] + q * query[1] + r)) / np.sqrt(1 + p * p + q * q)
        assert distance == pytest.approx(expected, abs=1e-9)
        assert away == pytest.approx(min(np.hypot(*(corner[:2] - query[:2])) for corner in corners))


def test_the_surface_goes_on_level_around_its_points_and_ends(hills):
    surface = Triangles(hills)
    lowest = hills[np.argmin(hills[:, 0])]
    beside = lowest + [-2.0, 0, 0.5]
    assert surface.height(beside[None, :2])[0] == pytest.approx(lowest[2], abs=0.5)
    far = np.array([[60.0, 4.0, 0.0], [5.0, -30.0, 0.0]])
    assert np.isnan(surface.height(far[:, :2])).all()
    assert np.isinf(surface.seen(far)[0]).all()


def test_large_coordinates_give_the_same_surface(hills):
    queries = np.random.default_rng(3).uniform([1, 1, -1], [9, 7, 1], (50, 3))
    offset = [500_000.0, 3_500_000.0, 0.0]
    moved = Triangles(hills + offset)
    assert moved.height((queries + offset)[:, :2]) == pytest.approx(Triangles(hills).height(queries[:, :2]), abs=1e-7)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_points_make_a_surface_too(count):
    points = np.array([[0.0, 0, 5.0], [1, 1, 5], [2, 2, 5]])[:count]
    assert Triangles(points).height(points[:, :2] + 0.3) == pytest.approx(np.full(count, 5.0))


def test_the_lowest_point_of_each_cell_is_that_of_a_loop():
    xyz = np.random.default_rng(0).uniform([-3, 7, 0], [4, 11, 2], (300, 3))
    low = xyz[:, :2].min(axis=0)
    lowest: dict[tuple[int, int], int] = {}
    for index, point in enumerate(xyz):
        cell = tuple(np.floor((point[:2] - low) / 0.7).astype(int).tolist())
        if cell not in lowest or point[2] < xyz[lowest[cell], 2]:
            lowest[cell] = index
    assert sorted(lowest_of_cells(xyz, 0.7)) == sorted(lowest.values())


def supported_by_loop(xyz: np.ndarray) -> set[int]:
    cells: dict[tuple[int, int], list[int]] = {}
    for index, cell in enumerate(np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / 0.5).astype(int).tolist()):
        cells.setdefault(tuple(cell), []).append(index)
    found = set()
    for members in cells.values():
        heights = xyz[members, 2]
        for index in sorted(members, key=lambda i: xyz[i, 2]):
            above = np.count_nonzero((heights >= xyz[index, 2]) & (heights <= xyz[index, 2] + 0.1))
            if above >= 0.012 * len(members):
                found.add(index)
                break
    return found


def test_the_lowest_supported_point_of_each_cell_is_that_of_a_loop():
    rng = np.random.default_rng(4)
    xyz = np.column_stack([rng.uniform(0, 2, (4000, 2)), rng.exponential(0.5, 4000) ** 2])
    xyz[:40, 2] -= rng.uniform(0, 3, 40)
    assert set(lowest_supported(xyz).tolist()) == supported_by_loop(xyz)
    # some of the lowest are not supported, or nothing is tested
    assert set(lowest_of_cells(xyz, 0.5).tolist()) != supported_by_loop(xyz)


def test_single_low_returns_are_dropped_and_cells_with_few_returns_are_kept():
    rng = np.random.default_rng(5)
    dense = np.column_stack([rng.uniform(0, 0.5, (200, 2)), rng.normal(0, 0.02, 200)])
    dense[0] = [0.0, 0.0, -1.0]
    sparse = np.array([[0.7, 0.2, 3.0], [0.8, 0.3, 0.0], [0.9, 0.3, 6.0]])
    found = lowest_supported(np.vstack([dense, sparse]))
    assert len(found) == 2
    assert found[0] == 1 + np.argmin(dense[1:, 2])
    assert found[1] == 201


def test_the_order_of_points_does_not_matter_where_heights_are_alike():
    rng = np.random.default_rng(6)
    xyz = np.column_stack([rng.uniform(0, 4, (2000, 2)), rng.integers(0, 3, 2000) * 0.01])
    order = rng.permutation(2000)
    for choose in (lowest_supported, lambda points: lowest_of_cells(points, 1.0)):
        assert np.array_equal(xyz[choose(xyz)], xyz[order][choose(xyz[order])])


def test_no_points_have_no_lowest():
    nothing = np.zeros((0, 3))
    assert len(lowest_of_cells(nothing, 1.0)) == len(lowest_supported(nothing)) == len(densified(nothing)) == 0


def rough(xy: np.ndarray, height: np.ndarray, seed: int = 7) -> np.ndarray:
    return np.column_stack([xy, height + np.random.default_rng(seed).normal(0, 0.015, len(xy))])


def test_a_cone_and_a_ridge_are_ground_to_their_tops():
    xy = jittered_grid(40.0, 0.5)
    from_top, from_crest = np.hypot(*(xy - [12.0, 12.0]).T), np.abs(xy[:, 0] - 30.0)
    height = np.clip(1.4 - 0.25 * from_top, 0, None) + np.clip(1.2 - 0.25 * from_crest, 0, None)
    points = rough(xy, height)
    found = densified(points)
    for place in (from_top > 0, from_top < 1.0, from_crest < 0.5):
        assert found[place].mean() > 0.9
    # layers are looked for to 0.3 m below the surface and 0.7 m above it
    error = Triangles(points[found]).height(xy) - height
    assert -0.35 < error.min() < error.max() < 0.15


def test_canopy_without_ground_below_is_no_ground_and_the_ground_around_it_is():
    xy = jittered_grid(50.0, 0.5)
    rng = np.random.default_rng(8)
    crown = (np.abs(xy - [15.0, 20.0]).max(axis=1) < 4.0) | (np.hypot(*(xy - [38.0, 30.0]).T) < 6.0)
    height = np.where(crown, rng.uniform(1.5, 7.0, len(xy)), 0.1 * np.sin(xy[:, 0] / 4))
    found = densified(rough(xy, height))
    assert not found[crown].any()
    assert found[~crown].mean() > 0.97


def test_single_pits_are_no_ground_and_take_nothing_away():
    xy = jittered_grid(30.0, 0.5)
    pit = np.zeros(len(xy), dtype=bool)
    pit[np.arange(150, len(xy), 331)] = True
    found = densified(rough(xy, np.where(pit, -1.5, 0.0)))
    assert not found[pit].any()
    assert found[~pit].mean() > 0.97


def test_nothing_is_told_of_what_lies_far_beyond_the_sure_points():
    """What is level with the ground 40 m away, and higher in between, may be anything."""
    xy = jittered_grid(60.0, 0.5)
    sure, far = xy[:, 0] < 10, xy[:, 0] > 50
    height = np.where(sure, 0.0, np.where(far, 0.6, 9.0 + 0.2 * np.random.default_rng(9).normal(size=len(xy))))
    found = densified(rough(xy, height), sure)
    assert found[sure].mean() > 0.97
    assert not found[~sure].any()


def test_sure_points_in_a_crown_are_no_seeds_where_the_ground_is_beside():
    xy = jittered_grid(50.0, 0.5)
    crown = np.abs(xy - [25.0, 25.0]).max(axis=1) < 2.0
    found = densified(rough(xy, np.where(crown, 6.0, 0.0)), np.hypot(*(xy - [25.0, 25.0]).T) < 12)
    assert not found[crown].any()
    assert found[~crown].mean() > 0.97


def test_without_sure_points_the_lowest_are_the_seeds():
    xy = jittered_grid(20.0, 0.5)
    assert densified(rough(xy, 0.2 * xy[:, 0]), np.zeros(len(xy), dtype=bool)).mean() > 0.97


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("count", [1, 2, 3, 8, 60])
def test_points_on_a_line_are_ground(count):
    points = np.column_stack([np.arange(count) * 0.6, np.zeros((count, 2))])
    assert densified(points).all()
