"""Outliers are taken, sparse ground is not."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.ground.outliers import outliers


@pytest.fixture(scope="module")
def scene() -> tuple[np.ndarray, np.ndarray]:
    """Under a closed canopy 6 m up, single ground points metres apart; and which points are ground."""
    rng = np.random.default_rng(0)
    canopy = np.column_stack([rng.uniform(0, 60, (60_000, 2)), 6 + rng.normal(0, 0.6, 60_000)])
    ground = np.column_stack([rng.uniform(0, 60, (1200, 2)), rng.normal(0, 0.05, 1200)])
    return np.vstack([canopy, ground]), np.arange(61_200) >= 60_000


def test_ground_seen_through_gaps_is_no_noise(scene):
    xyz, ground = scene
    # a third of a point on a square metre: the usual test, three neighbours within a metre, would take most of it
    found = outliers(xyz, 1.0, 10)
    assert not found[ground].any()
    assert found.sum() <= 1e-3 * len(xyz)


@pytest.mark.parametrize("dz", [-1e6, -1e4, -50.0, -5.0, -2.5, 12.0, 30.0, 1e5])
def test_strays_below_and_above_are_taken_and_nothing_else(scene, dz):
    xyz, _ground = scene
    rng = np.random.default_rng(1)
    place = rng.uniform(5, 55, (8, 2))
    strays = np.column_stack([place, np.full(8, dz)])
    found = outliers(np.vstack([xyz, strays]), 1.0, 10)
    assert found[len(xyz) :].all()
    assert np.array_equal(found[: len(xyz)], outliers(xyz, 1.0, 10))


def test_a_small_group_is_taken_and_a_larger_one_is_not(scene):
    xyz, _ = scene
    rng = np.random.default_rng(2)
    group = np.array([30.0, 30.0, -8.0]) + rng.uniform(-0.2, 0.2, (10, 3))
    assert outliers(np.vstack([xyz, group]), 1.0, 10)[-10:].all()
    assert not outliers(np.vstack([xyz, group]), 1.0, 9)[-10:].any()


@pytest.mark.parametrize("far", [1e4, 1e7, 1e12])
def test_strays_far_beside_are_taken_and_do_not_make_the_rest_look_sparse(scene, far):
    xyz, _ = scene
    strays = np.array([[far, 0, 0], [0, -far, 3], [-far, far, 0]])
    found = outliers(np.vstack([xyz, strays, [[30, 30, -5.0]]]), 1.0, 10)
    assert found[-4:].all()


def test_a_sparse_cloud_widens_the_distance():
    rng = np.random.default_rng(3)
    xyz = np.column_stack([rng.uniform(0, 400, (4000, 2)), rng.normal(0, 0.3, 4000)])  # 40 m² a point
    assert not outliers(xyz, 1.0, 10).any()
    assert outliers(np.vstack([xyz, [[200, 200, -150.0]]]), 1.0, 10)[-1]


def test_a_cloud_of_few_points_is_not_all_noise():
    xyz = np.random.default_rng(4).uniform(0, 2, (8, 3))
    assert not outliers(xyz, 1.0, 10).any()
    assert outliers(np.empty((0, 3)), 1.0, 10).shape == (0,)
