"""Registration against known motions, where a part of the surface really changed."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import shapely
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.registration import alignment
from slopewatch.engine.registration.register import register
from slopewatch.interface.parameters import InputParameters, RegistrationParameters

UTM = np.array([500_000.0, 3_500_000.0, 100.0])
SIDE = 20.0


@cache
def relief() -> np.ndarray:
    rng = np.random.default_rng(0)
    rough = sum(
        weight * gaussian_filter(rng.normal(size=(401, 401)), sigma) * sigma
        for sigma, weight in ((3, 0.06), (10, 0.12), (30, 0.3))
    )
    return np.asarray(rough)


def scan(seed: int, *, n: int = 60_000, lowered: float = 0.0, noise: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """A rough 35 degree slope at projected coordinates; a corner of 15 % is lowered. Points, and which are stable."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SIDE, (2, n))
    z = 0.7 * y + map_coordinates(relief(), [y * 20, x * 20], order=1) + rng.normal(0, noise, n)
    corner = (x < 0.39 * SIDE) & (y < 0.39 * SIDE)
    return UTM + np.column_stack([x, y, z - np.where(corner, lowered, 0.0)]), ~corner


def motion(seed: int, offset: float = 0.2) -> RigidTransform:
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    return RigidTransform(
        Rotation.from_rotvec(rng.normal(0, 3e-4, 3)).as_matrix(),
        offset * direction / np.linalg.norm(direction),
        UTM + [SIDE / 2, SIDE / 2, 7.0],
    )


def error(found: RigidTransform, truth: RigidTransform, points: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((found.apply(points) - truth.apply(points)) ** 2, axis=1))))


@pytest.fixture(scope="module")
def changed():
    reference, _ = scan(1)
    after, stable = scan(2, lowered=0.3)
    truth = motion(3)
    return reference, truth.inverse().apply(after), stable, truth


def test_real_change_does_not_pull_the_robust_method_along(changed):
    reference, moving, stable, truth = changed
    robust = register(reference, moving, RegistrationParameters())
    assert error(robust.transform, truth, moving[stable]) < 0.003
    # the same job shows that a method can be pulled along
    plain = register(reference, moving, RegistrationParameters(method="icp", maximum_correspondence=0.5))
    assert error(plain.transform, truth, moving[stable]) > 0.01
    assert robust.agreement.stable_share == pytest.approx(stable.mean(), abs=0.08)


def test_stated_error_fits_the_error_made():
    """Over seeds, the height error is of the size that the registration states."""
    ratios = []
    for seed in range(5):
        reference, _ = scan(10 + seed, n=30_000)
        after, _ = scan(20 + seed, n=30_000)
        truth = motion(seed)
        moving = truth.inverse().apply(after)
        result = register(reference, moving, RegistrationParameters())
        # along the normal: what a height of the surface suffers
        away = result.transform.apply(moving) - truth.apply(moving)
        normal = np.array([0.0, -0.7, 1.0]) / np.hypot(0.7, 1.0)
        ratios.append(float(np.sqrt(np.mean((away @ normal) ** 2))) * np.hypot(0.7, 1.0) / result.registration_error)
    assert 0.05 < np.sqrt(np.mean(np.square(ratios))) < 2.5


def test_projected_coordinates_cost_no_digits(changed):
    reference, moving, *_ = changed
    far = register(reference, moving, RegistrationParameters()).transform
    near = register(reference - UTM, moving - UTM, RegistrationParameters()).transform
    assert np.abs(far.apply(moving) - (near.apply(moving - UTM) + UTM)).max() < 1e-6


@pytest.mark.parametrize("offset", [0.0, 0.5, 0.9])
def test_offsets_up_to_the_largest_expected_are_found(offset):
    reference, _ = scan(1)
    after, _ = scan(4)
    truth = motion(5, offset)
    result = register(reference, truth.inverse().apply(after), RegistrationParameters(maximum_offset=1.0))
    assert error(result.transform, truth, after) < 0.003


def test_the_same_input_gives_the_same_transform(changed):
    reference, moving, *_ = changed
    first, second = (register(reference, moving, RegistrationParameters()).transform.matrix for _ in range(2))
    assert np.array_equal(first, second)


def test_a_stable_area_is_obeyed_where_most_of_the_surface_moved():
    """Two thirds went down; told which third stayed, the registration holds on to it."""
    reference, _ = scan(1)
    after, _ = scan(2)
    west = after[:, 0] < UTM[0] + SIDE / 3
    after[~west, 2] -= 0.3
    truth = motion(7, 0.1)
    moving = truth.inverse().apply(after)
    area = shapely.box(UTM[0], UTM[1], UTM[0] + SIDE / 3 - 0.5, UTM[1] + SIDE)
    told = register(reference, moving, RegistrationParameters(), stable=area)
    assert error(told.transform, truth, moving[west]) < 0.005
    with pytest.raises(InputError, match="--stable"):
        register(reference, moving, RegistrationParameters())


def test_a_plane_is_told_to_slide_along_itself():
    rng = np.random.default_rng(0)
    clouds = []
    for _ in range(2):
        x, y = rng.uniform(0, SIDE, (2, 40_000))
        clouds.append(UTM + np.column_stack([x, y, 0.7 * y + rng.normal(0, 0.01, x.size)]))
    result = register(*clouds, RegistrationParameters())
    assert len(result.unobservable) >= 2
    assert any("slide" in w or "direction" in w or "along" in w for w in result.warnings)
    rough, _ = scan(1)
    assert not register(rough, scan(2)[0], RegistrationParameters()).unobservable


def test_nearest_neighbour_figures_are_those_of_a_tree(changed):
    reference, moving, *_ = changed
    result = register(reference, moving, RegistrationParameters(method="none"))
    assert np.array_equal(result.transform.matrix, np.eye(4))
    distance, _ = cKDTree(reference).query(moving)
    assert result.nn_rmse_before == pytest.approx(float(np.sqrt(np.mean(distance**2))), rel=0.15)


def test_clouds_that_cannot_be_registered_are_refused_with_a_reason():
    reference, _ = scan(1, n=5000)
    with pytest.raises(InputError, match="overlap"):
        register(reference, reference + [1000.0, 0, 0], RegistrationParameters())
    with pytest.raises(InputError):
        register(reference, reference[:3], RegistrationParameters())
    broken = reference.copy()
    broken[7, 2] = np.nan
    with pytest.raises(InputError, match="finite"):
        register(reference, broken, RegistrationParameters())
    line = UTM + np.linspace(0, SIDE, 5000)[:, None] * [1.0, 1.0, 0.5]
    with pytest.raises(InputError):
        register(line, line, RegistrationParameters())


def test_a_real_cloud_in_two_halves(shared_data):
    cloud = read_cloud(shared_data / "real" / "lone-star.copc.laz", InputParameters(crs="EPSG:32614")).xyz
    half = np.random.default_rng(1).permutation(len(cloud)) < len(cloud) // 2
    reference, after = cloud[half], cloud[~half].copy()
    middle = cloud.mean(axis=0)
    near = np.hypot(*(after[:, :2] - middle[:2]).T)
    lowered = near <= np.quantile(near, 0.15)
    after[lowered, 2] -= 0.3
    truth = RigidTransform(
        Rotation.from_rotvec([2e-4, -1e-4, 1e-4]).as_matrix(), np.array([0.12, -0.12, 0.106]), middle
    )
    moving = truth.inverse().apply(after)
    result = register(reference, moving, RegistrationParameters())
    assert error(result.transform, truth, moving[~lowered]) < 0.002


def test_a_seam_of_overlap_is_told_to_fix_next_to_nothing():
    reference, _ = scan(1)
    beside = scan(2)[0] + [SIDE - 0.2, 0.0, 0.0]
    result = register(reference, beside, RegistrationParameters(maximum_offset=0.2))
    assert len(result.unobservable) >= 3
    assert any("does not fix" in warning for warning in result.warnings)


def test_all_points_are_used_where_fewer_do_not_fix_the_position_well_enough(monkeypatch):
    reference, moving = scan(1, n=40_000)[0], scan(2, n=40_000)[0]
    monkeypatch.setattr(alignment, "_MANY_SOURCES", 1000)
    stated, made = [], []
    for precise in (1.0, 1e-3):  # metres
        monkeypatch.setattr(alignment, "_MAX_PRECISE_ERROR_M", precise)
        found = register(reference, moving, RegistrationParameters())
        stated.append(float(np.sqrt(np.trace(found.covariance[3:, 3:]))))
        made.append(float(np.linalg.norm(found.transform.apply(UTM + [10.0, 10.0, 7.0]) - UTM - [10.0, 10.0, 7.0])))
    assert stated[0] > 1e-3
    assert stated[1] < 0.6 * stated[0]
    assert made[0] < 3 * stated[0]
    assert made[1] < 3 * stated[1]
