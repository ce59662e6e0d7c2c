"""Clouds that are written, read again by PDAL."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from slopewatch.engine.pointcloud.reading import read_cloud, read_dimension
from slopewatch.engine.pointcloud.writing import copy_with, write_cloud
from slopewatch.tests.builders.pdal_columns import by_pdal


def test_pdal_reads_what_is_written(tmp_path, las_file):
    cloud = read_cloud(las_file(tmp_path / "a.laz", points=60_000), colours=True)
    assert cloud.rgb is not None
    share = np.linspace(0, 1, len(cloud), dtype=np.float32)
    ids = np.arange(len(cloud), dtype=np.int32) - 5
    write_cloud(tmp_path / "b.laz", cloud, dimensions={"share": share, "zone": ids})
    names = ("X", "Y", "Z", "Intensity", "Classification", "ReturnNumber", "NumberOfReturns", "Red", "Blue")
    found = by_pdal(tmp_path / "b.laz", *names, "share", "zone")
    assert np.abs(np.column_stack([found[axis] for axis in "XYZ"]) - cloud.xyz).max() <= 0.0005 + 1e-8
    assert np.array_equal(found["Intensity"], cloud.intensity)
    assert np.array_equal(found["Classification"], cloud.classification)
    assert (found["ReturnNumber"] == 1).all()
    assert (found["NumberOfReturns"] == 1).all()
    assert np.array_equal(found["Red"], cloud.rgb[:, 0].astype(int) * 257)
    assert np.array_equal(found["Blue"], cloud.rgb[:, 2].astype(int) * 257)
    assert np.abs(found["share"] - share).max() < 1e-6
    assert np.array_equal(found["zone"], ids)


@pytest.mark.parametrize(("point_format", "version"), [(3, "1.2"), (7, "1.4")])
def test_pdal_reads_what_is_copied(tmp_path, las_file, point_format, version):
    def scaled(las):
        las.add_extra_dim(laspy.ExtraBytesParams("tilt", "i2", scales=np.array([0.5]), offsets=np.array([10.0])))
        las.tilt = 10.0 + 0.5 * (np.arange(len(las.points)) % 90)
        las.withheld = np.arange(len(las.points)) % 2

    source = las_file(tmp_path / "a.las", point_format=point_format, version=version, change=scaled)
    keep = np.arange(2000) % 3 > 0
    copy_with(source, tmp_path / "b.laz", keep=keep, dimensions={"zone": np.arange(keep.sum(), dtype=np.uint32)})
    names = ("X", "Y", "Z", "Intensity", "ReturnNumber", "NumberOfReturns", "PointSourceId", "GpsTime", "Green")
    before, after = by_pdal(source, *names, "Classification"), by_pdal(tmp_path / "b.laz", *names, "Classification")
    for name, values in before.items():
        assert np.array_equal(values[keep], after[name]), name
    added = by_pdal(tmp_path / "b.laz", "tilt", "zone")
    assert np.array_equal(added["tilt"], (10.0 + 0.5 * (np.arange(2000) % 90))[keep])
    assert np.array_equal(added["zone"], np.arange(keep.sum()))
    assert np.array_equal(read_dimension(tmp_path / "b.laz", "tilt"), added["tilt"])
