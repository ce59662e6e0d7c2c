"""Pyramids against brute-force neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.models.pyramid import build_pyramid


def test_every_level_holds_the_nearest_points():
    xyz = np.random.default_rng(1).uniform(0, 5, (600, 3))
    levels = build_pyramid(xyz, 3, 16, 4, np.random.default_rng(2))
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


@pytest.mark.parametrize("count", [1, 3, 17])
def test_a_block_of_few_points_has_a_pyramid(count):
    xyz = np.random.default_rng(4).uniform(0, 5, (count, 3))
    levels = build_pyramid(xyz, 3, 16, 4, np.random.default_rng(5))
    assert all(level.neighbours.shape[1] == 16 for level in levels)
    assert len(levels[-1].kept) == 1
    assert set(levels[0].neighbours.ravel().tolist()) == set(range(count)) or count == 17
