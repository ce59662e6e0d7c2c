"""Planes on cells are those of weighted least squares, and their priors pull them to nothing."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.plane_cells import Planes


def test_planes_are_those_of_weighted_least_squares():
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 4, (500, 2))
    z, weight = rng.normal(0, 1, 500), rng.uniform(0.1, 1, 500)
    planes = Planes(xy)
    found = planes.at_points(*planes.fit(z, weight, 0.0, 0.0))
    index = np.floor(xy)
    for cell in ([0, 0], [1, 2], [3, 3]):
        apart = np.abs(index - cell).max(axis=1)
        # the cell itself counts fully, those that share an edge half, those that share a corner a quarter
        pool = np.where(apart <= 1, 0.5 ** np.abs(index - cell).sum(axis=1), 0.0)
        root = np.sqrt(pool * weight)
        design = np.column_stack([np.ones(500), xy - np.array(cell) - 0.5])
        solution, *_ = np.linalg.lstsq(design * root[:, None], z * root, rcond=None)
        inside = (index == cell).all(axis=1)
        assert np.allclose(found[inside], (design @ solution)[inside], atol=1e-6)


def test_planes_of_cells_alone_are_those_of_their_own_points():
    rng = np.random.default_rng(5)
    xy, z = rng.uniform(0, 3, (90, 2)), rng.normal(0, 1, 90)
    planes = Planes(xy, pool=Planes.ALONE)
    found = planes.at_points(*planes.fit(z, np.ones(90), 0.0, 0.0))
    inside = (np.floor(xy) == [1, 2]).all(axis=1)
    design = np.column_stack([np.ones(inside.sum()), xy[inside]])
    solution, *_ = np.linalg.lstsq(design, z[inside], rcond=None)
    assert np.allclose(found[inside], design @ solution, atol=1e-6)


def test_sums_and_pools_are_those_of_loops():
    xy = np.random.default_rng(4).uniform(0, [5, 3], (200, 2))
    planes = Planes(xy)
    sums = np.zeros((5, 3))
    for x, y in xy:
        sums[int(x), int(y)] += x
    assert planes.shape == (5, 3)
    assert np.allclose(planes.sum(xy[:, 0]), sums)
    pooled = np.zeros((5, 3))
    for row, column in np.ndindex(5, 3):
        for r, c in np.ndindex(5, 3):
            if max(abs(r - row), abs(c - column)) <= 1:
                pooled[row, column] += sums[r, c] * 0.5 ** (abs(r - row) + abs(c - column))
    assert np.allclose(planes.pooled(sums), pooled)


def test_one_point_makes_a_level_plane_through_it_and_none_makes_zero():
    planes = Planes(np.array([[0.2, 0.3], [6.7, 0.1]]))
    height = planes.at_points(*planes.fit(np.array([2.0, 3.0]), np.array([1.0, 0.0]), 0.0, 0.05))
    assert height == pytest.approx([2.0, 0.0], abs=1e-6)
