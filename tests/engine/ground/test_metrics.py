"""Areas and vegetation cover against counts done another way."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from slopewatch.engine.ground.metrics import coverage, file_coverage, vegetation_cover
from slopewatch.engine.pointcloud import records
from slopewatch.engine.pointcloud.reading import open_cloud


def test_coverage_counts_occupied_square_metres():
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-7, 9, (300, 3)) + [500_000, 3_500_000, 0]
    assert coverage(xyz) == len({(int(np.floor(x)), int(np.floor(y))) for x, y, _ in xyz})
    assert coverage(np.empty((0, 3))) == 0.0


def test_coverage_of_a_file_is_that_of_its_points(las_file, tmp_path, monkeypatch):
    path = las_file(tmp_path / "a.laz", crs="EPSG:2222", points=60_000)  # Arizona East, international feet
    monkeypatch.setattr(records, "_GROUP_BYTES", 1)  # a chunk at a time
    found = file_coverage(*open_cloud(path))
    xyz = np.array(laspy.read(path).xyz) * 0.3048
    assert found.area == coverage(xyz)
    assert found.bounds == pytest.approx((*xyz[:, :2].min(axis=0), *xyz[:, :2].max(axis=0)))
    assert found.largest_class == 5


@pytest.mark.parametrize("dip", [0.0, 40.0])
def test_vegetation_cover_is_the_share_of_ground_under_crowns(dip):
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, 20, (120_000, 2))
    slope = np.tan(np.radians(dip))
    base = slope * xy[:, 1]
    covered = np.hypot(xy[:, 0] % 5 - 2.5, xy[:, 1] % 5 - 2.5) < 1.6
    hit = covered & (rng.random(len(xy)) < 0.7)
    z = base + np.where(hit, rng.uniform(0.5, 2.0, len(xy)), rng.normal(0, 0.02, len(xy)))
    xyz = np.column_stack([xy, z])
    c, s = np.cos(np.radians(dip)), np.sin(np.radians(dip))
    flat = np.column_stack([xy[:, 0], c * xy[:, 1] + s * z, c * z - s * xy[:, 1]])
    expected = np.pi * 1.6**2 / 25
    assert vegetation_cover(xyz, flat, ~hit, dip) == pytest.approx(expected, abs=0.03)
    assert vegetation_cover(xyz[~hit], flat[~hit], np.ones((~hit).sum(), bool), dip) < 0.001
    assert vegetation_cover(xyz, flat, np.zeros(len(xyz), bool), dip) == 0.0
