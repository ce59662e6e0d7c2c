"""The returns that objects are sought in, as they are read from a file."""

from __future__ import annotations

import laspy
import numpy as np
import pyproj
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.objects.survey import VOXEL_M, read_survey


def written(path, xyz, classes, number, total):
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.offsets, header.scales = np.zeros(3), np.full(3, 0.001)
    header.add_crs(pyproj.CRS.from_epsg(6677))
    las = laspy.LasData(header)
    las.xyz, las.classification = xyz, classes
    las.return_number, las.number_of_returns = number, total
    las.write(path)
    return path


def test_one_return_of_each_voxel_is_kept_with_its_class_and_moved(tmp_path):
    random = np.random.default_rng(1)
    xyz = random.uniform(0.0, 3.0, (4000, 3))
    classes = np.where(xyz[:, 2] < 1.0, 2, 1)
    number = np.where(xyz[:, 2] > 2.0, 1, 2)
    path = written(tmp_path / "a.las", xyz, classes, number, np.full(4000, 2))
    moved = RigidTransform(np.eye(3), np.array([10.0, 20.0, 0.0]), np.zeros(3))
    survey = read_survey(path, moved)
    voxels, every = (np.floor(points / VOXEL_M) for points in (survey.xyz, moved.apply(np.array(laspy.read(path).xyz))))
    assert len(np.unique(voxels, axis=0)) == len(survey) == len(np.unique(every, axis=0))
    assert (survey.xyz.min(axis=0) >= [10.0, 20.0, 0.0]).all()
    np.testing.assert_array_equal(survey.ground, survey.xyz[:, 2] < 1.0)
    np.testing.assert_array_equal(survey.last, survey.xyz[:, 2] <= 2.0)


def test_without_return_numbers_every_return_may_be_the_last(tmp_path):
    xyz = np.random.default_rng(1).uniform(0.0, 3.0, (50, 3))
    nothing = np.zeros(50, dtype=np.uint8)
    assert read_survey(written(tmp_path / "a.las", xyz, nothing, nothing, nothing)).last.all()
