"""The published ICP against a brute-force version of the same steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.registration.icp import icp, rigid_fit


def surface(seed: int, n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1.5, 1.5, (2, n))
    return np.column_stack([x, y, 0.5 * x + 0.2 * np.sin(3 * y) + 0.2 * np.cos(2 * x * y)])


def brute_force(reference: np.ndarray, moving: np.ndarray, distance: float, iterations: int):
    """Point-to-point ICP with all distances computed, the fit by quaternions (Horn 1987), not by an SVD."""
    moved = moving.copy()
    previous = np.inf
    for _ in range(iterations):
        all_distances = np.linalg.norm(moved[:, None] - reference[None], axis=2)
        nearest = all_distances.argmin(axis=1)
        near = all_distances.min(axis=1)
        pairs = near <= distance
        rmse = float(np.sqrt(np.mean(near[pairs] ** 2)))
        if abs(previous - rmse) < 1e-6:
            break
        previous = rmse
        source, target = moved[pairs], reference[nearest[pairs]]
        turn, _ = Rotation.align_vectors(target - target.mean(0), source - source.mean(0))
        moved = turn.apply(moved - source.mean(0)) + target.mean(0)
    return moved


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_same_result_as_brute_force(seed):
    reference, moving = surface(seed), surface(seed)[50:] + [0.03, -0.02, 0.015]
    found = icp(reference, moving, distance=0.1, iterations=200)
    moved = brute_force(reference, moving, 0.1, 200)
    assert np.abs(found.pose.apply(moving) - moved).max() < 1e-4


def test_the_same_points_moved_a_little_are_brought_back_exactly():
    reference = surface(5)
    turn = Rotation.from_rotvec([0.004, -0.003, 0.005])
    moving = turn.apply(reference) + [0.01, 0.012, -0.008]
    found = icp(reference, moving, distance=0.1, iterations=200)
    assert found.converged
    assert np.abs(found.pose.apply(moving) - reference).max() < 1e-6


def test_rigid_fit_is_exact_and_never_mirrors():
    points = surface(6, 20)
    turn = Rotation.from_rotvec([0.7, -1.3, 2.0])
    pose = rigid_fit(points, turn.apply(points) + [1.0, 2.0, 3.0])
    assert np.abs(pose.rotation - turn.as_matrix()).max() < 1e-12
    flat = points * [1, 1, 0]
    mirrored = rigid_fit(flat, flat * [1, -1, 1])
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1.0)


def test_clouds_too_far_apart_for_the_distance_are_refused():
    with pytest.raises(InputError):
        icp(surface(1), surface(1) + [0.0, 0.0, 30.0], distance=0.1, iterations=10)
