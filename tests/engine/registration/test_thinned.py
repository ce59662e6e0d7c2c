"""Large surveys are registered by squares of their points: evenly chosen, and the same motion within its error."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from pyproj import CRS
from scipy.spatial.transform import Rotation
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.pointcloud import in_parts
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.in_parts import spool
from slopewatch.engine.pointcloud.plant_cover import ERROR, HEIGHT
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.engine.registration.surveys import register_surveys
from slopewatch.engine.registration.thinned import Squares, evenly_chosen, points_in, square_of
from slopewatch.interface.parameters import InputParameters, RegistrationParameters
from slopewatch.tests.builders.turned_slope import turned_slope


def motion(centre: np.ndarray) -> RigidTransform:
    rotation = Rotation.from_rotvec([2e-4, -3e-4, 1e-4]).as_matrix()
    return RigidTransform(rotation, np.array([0.1, -0.12, 0.08]), centre)


@pytest.fixture(scope="module")
def halves(shared_data) -> tuple[np.ndarray, np.ndarray, RigidTransform]:
    """A real surface in two halves, of which one is displaced, and the motion that brings it back."""
    cloud = read_cloud(shared_data / "real" / "lone-star.copc.laz", InputParameters(crs="EPSG:32613")).xyz
    first = np.random.default_rng(1).random(len(cloud)) < 0.5
    truth = motion(cloud.mean(axis=0))
    return cloud[first], truth.inverse().apply(cloud[~first]), truth


def test_real_halves_as_with_all_points(halves):
    reference, moving, truth = halves
    parameters, most = RegistrationParameters(), 60_000
    whole = register_surveys((reference, None), (moving, None), parameters)
    found = register_surveys((reference, None), (moving, None), parameters, most=most)
    assert whole.registered_points is None
    assert "registered_points" not in whole.summary()
    assert max(found.registered_points) <= most
    # a quarter of the points, of which bare ground has its own scatter
    assert found.registration_error < 3.0 * whole.registration_error
    for other in (whole.transform, truth):
        away = (found.transform.apply(moving) - other.apply(moving))[:, 2]
        assert np.sqrt(np.mean(away**2)) < found.registration_error
    assert found.inliers == pytest.approx(whole.inliers, rel=0.1)


def test_slope_with_plants_as_with_all_points():
    (first, cover), (second, later) = turned_slope(140.0)
    truth = motion(first.mean(axis=0))
    moving = truth.inverse().apply(second)
    surveys = (first, cover), (moving, later)
    whole = register_surveys(*surveys, RegistrationParameters())
    found = register_surveys(*surveys, RegistrationParameters(), most=25_000)
    assert max(found.registered_points) <= 25_000 < min(len(first), len(moving))
    rise = np.array([0.6 * -0.6, 0.6 * 0.8])  # of the slope, which hardly fixes what slides along it
    for other in (whole.transform, truth):
        away = found.transform.apply(moving) - other.apply(moving)
        assert np.sqrt(np.mean((away[:, 2] - away[:, :2] @ rise) ** 2)) < found.registration_error
    # a quarter of the points, of which bare ground has its own scatter
    assert found.registration_error < 3.0 * whole.registration_error
    assert found.plants is not None


def test_squares_depend_on_the_points_alone(tmp_path, monkeypatch):
    """Not on where they are held, nor on the parts in which they are read, nor on their order."""
    clouds, stored = [], []
    for number, (xyz, cover) in enumerate(turned_slope(60.0)):
        path = tmp_path / f"{number}.laz"
        dimensions = {ERROR: cover.error.astype("f4"), HEIGHT: cover.height.astype("f4")}
        write_cloud(path, PointCloud(xyz, CRS.from_epsg(32651), path), dimensions=dimensions)
        clouds.append(read_cloud(path))
        stored.append(spool(path, None, tmp_path / f"{number}.points"))
    held = evenly_chosen((clouds[0].xyz, clouds[1].xyz), 1.0, None, 9_000)
    shuffled = [cloud.xyz[np.random.default_rng(3).permutation(len(cloud.xyz))] for cloud in clouds]
    monkeypatch.setattr(in_parts, "_PART_POINTS", 1234)
    for points in (stored, shuffled):
        found = evenly_chosen((points[0], points[1]), 1.0, None, 9_000)
        assert found.side == held.side
        np.testing.assert_array_equal(found.taken, held.taken)
    xyz, cover = points_in(held, (stored[1], None))
    chosen = held.holds(clouds[1].xyz)
    assert 0 < np.count_nonzero(chosen) <= 9_000
    np.testing.assert_array_equal(xyz, clouds[1].xyz[chosen])
    np.testing.assert_array_equal(cover.error, clouds[1].plant_error[chosen])
    np.testing.assert_array_equal(cover.height, clouds[1].plant_height[chosen])
    assert evenly_chosen((stored[0], stored[1]), 1.0, None, len(stored[0]) + len(stored[1])) is None


def test_squares_lie_evenly():
    """Of a slope of 600 m each 60 m get their share of the points, within the size of a square."""
    rng = np.random.default_rng(0)
    xyz = np.column_stack([rng.uniform(0, 600, 200_000), rng.uniform(0, 48, 200_000), np.zeros(200_000)])
    squares = evenly_chosen((xyz, xyz), 1.0, None, 60_000)
    chosen = squares.holds(xyz)
    assert 0.25 < chosen.mean() <= 0.3
    share = np.bincount((xyz[chosen, 0] / 60).astype(int), minlength=10) / 20_000
    assert share.min() > 0.15
    assert share.max() < 0.45


def test_stable_ground_is_taken_first():
    rng = np.random.default_rng(0)
    xyz = np.column_stack([rng.uniform(-100, 500, 200_000), rng.uniform(-24, 24, 200_000), np.zeros(200_000)])
    area = shapely.box(-30.0, -20.0, -10.0, 20.0)
    squares = evenly_chosen((xyz, xyz), 1.0, area, 30_000)
    inside = shapely.contains_xy(area, xyz[:, 0], xyz[:, 1])
    assert squares.holds(xyz)[inside].all()
    assert squares.holds(xyz)[xyz[:, 0] > 200].any()
    assert squares.holds(xyz).sum() <= 30_000


def test_a_square_holds_its_points():
    xyz = np.array([[-0.1, 0.0, 5.0], [0.0, 0.0, 5.0], [11.9, 11.9, 5.0], [12.0, -0.1, 5.0]])
    number = square_of(xyz, 12.0)
    assert len(set(number.tolist())) == 3
    assert number[1] == number[2]
    np.testing.assert_array_equal(Squares(12.0, number[1:2]).holds(xyz), [False, True, True, False])
