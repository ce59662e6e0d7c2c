"""Dimensions read by name, against files that laspy wrote."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.pointcloud.reading import read_dimension


def written(path, point_format: int, **extra):
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2")
    header.scales = [0.001] * 3
    if point_format > 5:
        header.add_crs(CRS.from_epsg(32651))
    for name, values in extra.items():
        header.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype))
    las = laspy.LasData(header)
    rng = np.random.default_rng(4)
    las.x, las.y, las.z = rng.uniform(0, 50, (3, 200))
    las.classification = rng.integers(0, 20, 200)
    las.user_data = rng.integers(0, 255, 200)
    for name, values in extra.items():
        las[name] = values
    if point_format < 6:
        las.synthetic = np.arange(200) % 2
    las.write(str(path))
    return las


@pytest.mark.parametrize(("name", "point_format"), [("a.las", 3), ("a.laz", 6), ("a.laz", 2)])
def test_values_are_those_that_were_written(tmp_path, name, point_format):
    labels = (np.arange(200) % 3).astype(np.uint8)
    scalar = np.where(np.arange(200) % 7, labels, np.nan).astype(np.float32)
    las = written(
        tmp_path / name, point_format, other=np.arange(200, dtype=np.int32), slopewatch_class=labels, S=scalar
    )
    path = tmp_path / name
    np.testing.assert_array_equal(read_dimension(path, "slopewatch_class"), labels)
    np.testing.assert_array_equal(read_dimension(path, "Other"), np.arange(200))
    np.testing.assert_array_equal(read_dimension(path, "S"), scalar)
    np.testing.assert_array_equal(read_dimension(path, "Classification"), las.classification)
    np.testing.assert_array_equal(read_dimension(path, "user_data"), las.user_data)


def test_scaled_values_are_those_that_are_meant(tmp_path):
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_extra_dim(laspy.ExtraBytesParams("tilt", np.int16, scales=np.array([0.5]), offsets=np.array([10.0])))
    las = laspy.LasData(header)
    las.x = las.y = las.z = np.arange(4.0)
    las["tilt"] = np.array([10.0, 10.5, 11.0, 9.0])
    las.write(str(tmp_path / "a.las"))
    np.testing.assert_allclose(read_dimension(tmp_path / "a.las", "tilt"), [10.0, 10.5, 11.0, 9.0])


def test_a_missing_one_is_refused_with_those_that_are_there(tmp_path):
    written(tmp_path / "a.laz", 6, truth=np.zeros(200, dtype=np.uint8))
    with pytest.raises(
        InputError, match=r"a\.laz' has no dimension slopewatch_class; give one of truth, classification"
    ):
        read_dimension(tmp_path / "a.laz", "slopewatch_class")
