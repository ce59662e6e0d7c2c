"""The change of clouds that stay on the disk is that of the same clouds in memory."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.change.difference import listed_difference
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.grid import stored_tiles, tiled_points
from slopewatch.engine.ground import classified_ground
from slopewatch.engine.ground.classified_ground import contradicting_share
from slopewatch.engine.pointcloud import in_parts
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.in_parts import spool
from slopewatch.engine.pointcloud.plant_cover import ERROR, HEIGHT
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.tests.builders.equal_results import same
from slopewatch.tests.builders.turned_slope import turned_slope

TURN = RigidTransform(
    np.array([[np.cos(1e-4), -np.sin(1e-4), 0.0], [np.sin(1e-4), np.cos(1e-4), 0.0], [0.0, 0.0, 1.0]]),
    np.array([0.03, -0.02, 0.01]),
    np.array([540.0, 930.0, 100.0]),
)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path]:
    """Two surveys with plants, the second displaced."""
    folder, found = tmp_path_factory.mktemp("spooled"), []
    for number, (xyz, cover) in enumerate(turned_slope(60.0)):
        path = folder / f"{number}.laz"
        cloud = PointCloud(xyz if not number else TURN.inverse().apply(xyz), CRS.from_epsg(32651), path)
        write_cloud(path, cloud, dimensions={ERROR: cover.error.astype("f4"), HEIGHT: cover.height.astype("f4")})
        found.append(path)
    return found[0], found[1]


@pytest.mark.parametrize(
    "parameters",
    [ChangeParameters(), ChangeParameters(cell=0.2), ChangeParameters(cell=0.5, largest_cell=2.0)],
    ids=["cell by the points", "given", "largest given"],
)
@pytest.mark.parametrize("at_once", [1_000_000, 1000], ids=["one tile", "many tiles"])
def test_on_the_disk_as_in_memory(files, tmp_path, monkeypatch, parameters, at_once):
    monkeypatch.setattr(in_parts, "_PART_POINTS", 1700)
    monkeypatch.setattr(tiled_points, "_AT_ONCE", at_once)
    monkeypatch.setattr(tiled_points, "_TILE", 64)
    first, second = (read_cloud(path) for path in files)
    stored = [spool(path, None, tmp_path / path.stem) for path in files]
    held = listed_difference(
        first.xyz, TURN.apply(second.xyz), parameters, plants=(first.plants, second.plants), registration_error=0.004
    )
    found = listed_difference(stored[0], stored[1].moved(TURN), parameters, registration_error=0.004)
    assert np.isfinite(found.dz).sum() > 1000
    assert found.plants is not None
    same(held, found)


def test_windows_with_many_points_are_worked_on_in_parts(files, tmp_path, monkeypatch):
    """Sums begin in another place then, which shows in their last digits only."""
    parameters = ChangeParameters(cell=0.2)
    stored = [spool(path, None, tmp_path / path.stem) for path in files]
    whole = listed_difference(stored[0], stored[1].moved(TURN), parameters)
    monkeypatch.setattr(in_parts, "_PART_POINTS", 1700)
    monkeypatch.setattr(stored_tiles, "MAX_POINTS_AT_ONCE", 3000)
    parts = listed_difference(stored[0], stored[1].moved(TURN), parameters)
    np.testing.assert_array_equal(np.isfinite(whole.dz), np.isfinite(parts.dz))
    np.testing.assert_allclose(whole.dz, parts.dz, rtol=0, atol=1e-9, equal_nan=True)
    np.testing.assert_allclose(whole.level, parts.level, rtol=1e-6, equal_nan=True)


def test_points_of_one_class(files, tmp_path):
    """Of a cloud that somebody classified; what it says of plants is then of all its points, and not taken over."""
    cloud = read_cloud(files[0])
    labels = np.where(np.arange(len(cloud.xyz)) % 3 == 0, 2, 1)
    path = tmp_path / "classified.laz"
    dimensions = {ERROR: cloud.plant_error, HEIGHT: cloud.plant_height}
    write_cloud(path, cloud, dimensions=dimensions, classification=labels)
    found = spool(path, None, tmp_path / "points", label=2)
    wanted = cloud.xyz[labels == 2]
    assert len(found) == len(wanted)
    assert found.values == 0
    np.testing.assert_array_equal(found.every(1), wanted)
    np.testing.assert_array_equal(found.every(7), wanted[::7])
    np.testing.assert_array_equal(found.bounds, [wanted.min(axis=0), wanted.max(axis=0)])


@pytest.mark.parametrize("count", [1, 2, 3001, 3002])
def test_median_height(files, tmp_path, count):
    found = spool(files[0], None, tmp_path / "points")
    some = replace(found, count=count, transform=TURN)
    assert some.median_height() == np.median(some.every(1)[:count, 2])


def test_a_full_disk_is_refused_before_the_points_are_read(files, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=1000))
    with pytest.raises(InputError, match=r"The points of .*0\.laz' need .* GB on the disk .* and 1e-06 GB are free"):
        spool(files[0], None, tmp_path / "points")
    assert not (tmp_path / "points").exists()


@pytest.mark.parametrize("most", [2_000_000, 4_000], ids=["all", "some squares"])
def test_classes_are_checked_as_in_memory(files, tmp_path, monkeypatch, most):
    """A tenth of the points lies half a metre above the others."""
    cloud = read_cloud(files[0])
    lifted = cloud.xyz + np.outer(np.random.default_rng(4).random(len(cloud.xyz)) < 0.1, [0.0, 0.0, 0.5])
    path = tmp_path / "lifted.laz"
    write_cloud(path, PointCloud(lifted, cloud.crs, path))
    stored = spool(path, None, tmp_path / "points")
    monkeypatch.setattr(classified_ground, "MAX_POINTS", most)
    monkeypatch.setattr(in_parts, "_PART_POINTS", 1700)
    held = contradicting_share(read_cloud(path).xyz)
    assert 0.03 < held < 0.3
    assert contradicting_share(stored) == held
