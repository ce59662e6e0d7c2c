"""Pyramids against brute-force neighbours."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from slopewatch.models.preparation.pyramid import build_pyramid, evenly


def test_every_level_holds_the_nearest_points():
    xyz = np.random.default_rng(1).uniform(0, 5, (600, 3))
    levels = build_pyramid(xyz, 3, 16, 4, np.random.default_rng(2))
    assert len(levels) == 3
    points = xyz
    for level in levels:
        distance = np.linalg.norm(points[:, None] - points[None, :], axis=2)
        near = np.sort(distance, axis=1)[:, :16]
        np.testing.assert_allclose(np.take_along_axis(distance, level.neighbours.astype(int), axis=1), near, atol=1e-9)
        assert (level.neighbours[:, 0] == np.arange(len(points))).all()
        assert len(level.kept) == len(points) // 4
        assert (np.diff(level.kept) > 0).all()
        below = points[level.kept]
        to_kept = np.linalg.norm(points[:, None] - below[None, :], axis=2)
        np.testing.assert_allclose(to_kept[np.arange(len(points)), level.nearest], to_kept.min(axis=1), atol=1e-9)
        points = below


def test_the_kept_points_are_random_and_seeded():
    xyz = np.random.default_rng(3).uniform(0, 5, (400, 3))
    kept = [build_pyramid(xyz, 1, 4, 4, np.random.default_rng(seed))[0].kept for seed in range(40)]
    again = build_pyramid(xyz, 1, 4, 4, np.random.default_rng(0))[0].kept
    np.testing.assert_array_equal(kept[0], again)
    share = np.bincount(np.concatenate(kept), minlength=400) / 40
    assert share.mean() == pytest.approx(0.25)
    assert share.std() < 0.12


def test_evenly_kept_points_are_the_nearest_to_the_middles_of_squares():
    xyz, side = np.random.default_rng(6).uniform(-7, 9, (700, 3)), 0.8
    kept = evenly(xyz, side, np.random.default_rng(7))
    origin = np.random.default_rng(7).uniform(0.0, 1.0, 2)
    best: dict[tuple[int, int], tuple[float, int]] = {}
    for number, (x, y, _) in enumerate(xyz):
        column, row = int(np.floor(x / side + origin[0])), int(np.floor(y / side + origin[1]))
        middle = (np.array([column, row]) + 0.5 - origin) * side
        far = float(np.hypot(x - middle[0], y - middle[1]))
        best[column, row] = min(best.get((column, row), (np.inf, -1)), (far, number))
    assert sorted(number for _, number in best.values()) == kept.tolist()


def test_an_even_pyramid_leaves_no_holes_that_a_random_one_leaves():
    x, y = np.meshgrid(np.arange(0, 20, 0.4), np.arange(0, 20, 0.4))
    xyz = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    farthest = {}
    for spacing in (0.4, None):
        level = build_pyramid(xyz, 1, 10, 4, np.random.default_rng(8), spacing=spacing)[0]
        farthest[spacing] = np.linalg.norm(xyz - xyz[level.kept][level.nearest], axis=1).max()
        assert len(level.kept) == pytest.approx(len(xyz) / 4, rel=0.05)
    assert farthest[0.4] <= 0.4 * np.sqrt(2) + 1e-9 < farthest[None]


def test_even_levels_thin_by_the_decimation_each():
    x, y = np.meshgrid(np.arange(0, 60, 0.4), np.arange(0, 60, 0.4))
    xyz = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    levels = build_pyramid(xyz, 3, 10, 4, np.random.default_rng(9), spacing=0.4)
    sizes = [len(xyz), *(len(level.kept) for level in levels)]
    assert [a / b for a, b in pairwise(sizes)] == pytest.approx([4.0, 4.0, 4.0], rel=0.15)


@pytest.mark.parametrize("spacing", [None, 0.4])
@pytest.mark.parametrize("count", [1, 3, 17])
def test_a_block_of_few_points_has_a_pyramid(count, spacing):
    xyz = np.random.default_rng(4).uniform(0, 1, (count, 3))
    levels = build_pyramid(xyz, 3, 16, 4, np.random.default_rng(5), spacing=spacing)
    assert all(level.neighbours.shape[1] == 16 for level in levels)
    assert len(levels[-1].kept) == 1 if spacing is None else 1 <= len(levels[-1].kept) <= 4
    assert set(levels[0].neighbours.ravel().tolist()) == set(range(count)) or count == 17
