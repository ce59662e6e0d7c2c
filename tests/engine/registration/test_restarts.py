"""Surfaces of which so much has moved that weights alone settle in between."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.registration.point_to_plane import Matcher
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.restarts import Descent, Limits, descend, reconsider
from slopewatch.engine.registration.surface import Surface
from slopewatch.interface.parameters import InputParameters, RegistrationParameters


def slope(seed: int, n: int = 40_000, noise: float = 0.01) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 20, (2, n))
    relief = 0.3 * np.sin(0.4 * x + 1) * np.cos(0.5 * y) + 0.05 * np.sin(2.1 * x + y) + 0.03 * np.sin(3 * y - 1.7 * x)
    z = 0.7 * y + relief + rng.normal(0, noise, n)
    return np.column_stack([x - 10, y - 10, z])


def test_a_good_fit_is_left_alone():
    matcher = Matcher(Surface(slope(1), 0.1), Surface(slope(2), 0.1))
    sources = matcher.sample(20_000)
    first = descend(matcher, Descent(Pose.identity(), 0.25), sources, Limits(40, offset=1.0))
    assert reconsider(matcher, first, sources, Progress()) is first


def test_a_surface_knows_the_noise_put_in():
    assert Surface(slope(3, noise=0.03), 0.05).noise == pytest.approx(0.03 * np.cos(np.arctan(0.7)), rel=0.3)


def test_a_real_monument_of_which_the_telling_part_was_lowered(shared_data):
    """The disc holds the cone, which fixes most of the position."""
    cloud = read_cloud(shared_data / "real" / "lone-star.copc.laz", InputParameters(crs="EPSG:32614")).xyz
    middle = (cloud.min(axis=0) + cloud.max(axis=0)) / 2
    rng = np.random.default_rng(16)
    half = rng.random(len(cloud)) < 0.5
    reference, after = cloud[half], cloud[~half].copy()
    disc = cloud[rng.integers(len(cloud)), :2]
    distance = np.hypot(*(after[:, :2] - disc).T)
    lowered = distance < np.quantile(distance, 0.15)
    after[lowered, 2] -= 0.3
    truth = RigidTransform(
        Rotation.from_rotvec([3e-3, -3e-3, 3e-3]).as_matrix(), np.array([0.12, -0.12, 0.106]), middle
    )
    moving = truth.inverse().apply(after)
    found = register(reference, moving, RegistrationParameters()).transform
    error = found.apply(moving[~lowered]) - truth.apply(moving[~lowered])
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.001
