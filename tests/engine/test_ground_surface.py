"""The fitted surface keeps what the cloth cuts off and does not depend on tiles."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine import ground_surface as module
from slopewatch.engine.ground_surface import Planes, ground_near_surface, ground_surface, point_spacing

NOISE = 0.02


def field(count: int, size: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, size, (count, 2))


def shares(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    return (found & truth).sum() / truth.sum(), (found & truth).sum() / found.sum()


def with_plants(xy: np.ndarray, height: np.ndarray, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Points on ``height`` with noise, 60 % of them caught by leaves from 0.15 m up; and which are ground."""
    rng = np.random.default_rng(seed)
    leaf = rng.random(len(xy)) < 0.6
    z = height + rng.normal(0, NOISE, len(xy)) + np.where(leaf, rng.uniform(0.15, 0.6, len(xy)), 0.0)
    return np.column_stack([xy, z]), ~leaf


def test_ground_is_told_from_leaves_that_begin_just_above_it():
    xy = field(60_000, 12.0)
    xyz, ground = with_plants(xy, 0.1 * np.sin(xy[:, 0]))
    found = ground_near_surface(xyz, 0.06)
    recall, precision = shares(found.ground, ground)
    assert recall > 0.98
    assert precision > 0.98
    assert found.scatter == pytest.approx(NOISE, rel=0.35)
    assert found.threshold == 0.06


def test_a_step_and_a_cone_are_kept_to_their_edges():
    xy = field(60_000, 12.0)
    step = 0.16 * (np.abs(xy - [3.0, 6.0]).max(axis=1) < 0.5)
    distance = np.hypot(*(xy - [9.0, 6.0]).T)
    cone = np.clip(0.36 * (1 - distance / 0.53), 0, None)
    xyz, ground = with_plants(xy, step + cone)
    found = ground_near_surface(xyz, 0.06).ground
    for place in (step > 0, (distance < 0.5), distance < 0.15):
        assert shares(found[place], ground[place])[0] > 0.65
    inner = np.abs(xy - [3.0, 6.0]).max(axis=1) < 0.4
    assert np.mean(xyz[found & inner, 2]) == pytest.approx(0.16, abs=0.01)


def test_ground_beyond_the_cloths_reach_is_found_from_the_ground_beside_it():
    xy = field(60_000, 12.0)
    # the cloth lies level; a berm falls away from it at 45 degrees for 2.5 m
    height = -np.clip(xy[:, 0] - 5.0, 0, 2.5)
    xyz, ground = with_plants(xy, height)
    near = np.abs(xyz[:, 2]) < 0.3
    assert shares(near, ground)[0] < 0.5
    recall, precision = shares(ground_surface(xyz, near, 0.06).ground, ground)
    assert recall > 0.95
    assert precision > 0.95


def test_rough_ground_widens_the_threshold_with_its_scatter():
    rng = np.random.default_rng(2)
    xyz = np.column_stack([field(40_000, 12.0), rng.normal(0, 0.08, 40_000)])
    found = ground_near_surface(xyz, 0.06)
    assert found.scatter == pytest.approx(0.08, rel=0.3)
    assert found.threshold == pytest.approx(2.5 * found.scatter)
    assert found.ground.mean() > 0.9


def test_tiles_change_the_ground_by_no_more_than_its_seams(monkeypatch):
    xy = field(40_000, 20.0)
    xyz, _ = with_plants(xy, 0.3 * np.sin(xy[:, 0] / 2) * np.cos(xy[:, 1] / 3))
    whole = ground_surface(xyz, xyz[:, 2] < 1, 0.06).ground
    monkeypatch.setattr(module, "TILE", 6.0)
    monkeypatch.setattr(module, "MARGIN", 3.0)
    tiled = ground_surface(xyz, xyz[:, 2] < 1, 0.06).ground
    assert np.count_nonzero(whole != tiled) < 0.01 * np.count_nonzero(whole)


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


@pytest.mark.parametrize("spacing", [0.05, 0.25, 1.0, 6.0])
def test_spacing_is_that_of_a_grid(spacing):
    x, y = np.meshgrid(np.arange(80) * spacing + 0.001, np.arange(80) * spacing + 0.001)
    assert point_spacing(np.column_stack([x.ravel(), y.ravel()])) == pytest.approx(spacing, rel=0.1)


def test_few_points_are_no_ground():
    assert not ground_near_surface(np.zeros((2, 3)), 0.06).ground.any()
