"""Clouds clipped without PDAL are those that PDAL clips."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
import shapely
from slopewatch.engine.ground.pdal_pipelines import clip_pipeline
from slopewatch.engine.pointcloud.clipping import clip
from slopewatch.engine.pointcloud.reading import open_cloud
from slopewatch.engine.pointcloud.writing import put_flags_apart
from slopewatch.interface.parameters import InputParameters
from slopewatch.lab.benchmarks.real_data import DATA
from slopewatch.tests.builders.extracted_ground import any_pdal

HOLE = shapely.Point(500_008, 3_500_010).buffer(3)
AREA = shapely.MultiPolygon([
    shapely.Polygon([(500_002, 3_500_001), (500_017, 3_500_003), (500_014, 3_500_019), (500_001, 3_500_015)]) - HOLE,
    shapely.Point(500_024, 3_500_010).buffer(4),
])  # fmt: skip
METRES = InputParameters()


def every_value(las: laspy.LasData) -> None:
    """All that a record can hold, and extra dimensions with and without a scale."""
    rng = np.random.default_rng(3)
    count = len(las.points)
    for name in ("synthetic", "key_point", "withheld", "scan_direction_flag", "edge_of_flight_line", "overlap"):
        if name in set(las.point_format.dimension_names):
            las[name] = rng.integers(0, 2, count)
    las.user_data = rng.integers(0, 256, count)
    if las.point_format.id < 6:
        las.scan_angle_rank = rng.integers(-90, 91, count)
    else:
        las.scan_angle, las.scanner_channel = rng.integers(-30_000, 30_001, count), rng.integers(0, 4, count)
    las.add_extra_dim(laspy.ExtraBytesParams("ids", "u4"))
    las.add_extra_dim(laspy.ExtraBytesParams("tilt", "i2", scales=np.array([0.5]), offsets=np.array([10.0])))
    las.ids, las.tilt = rng.integers(0, 2**32, count), 10.0 + 0.5 * rng.integers(-90, 90, count)


def clipped_by_pdal(source: Path, output: Path, area: shapely.Geometry | None, inputs: InputParameters) -> None:
    header, frame = open_cloud(source, inputs)
    any_pdal().run(clip_pipeline(source, output, header, frame, area))


def same(own: Path, other: Path, *, flags_in_class: bool) -> int:
    """All values of all points in their order; their number. ``flags_in_class`` as PDAL 2.2 leaves them."""
    first, second = laspy.read(own), laspy.read(other)
    if flags_in_class:
        put_flags_apart(second.points)
    assert (first.header.version, first.point_format.id) == (second.header.version, second.point_format.id)
    # PDAL rounds a scale to six digits and then finds the nearest integers for it
    np.testing.assert_allclose(first.header.scales, second.header.scales, rtol=2e-6)
    np.testing.assert_allclose(first.xyz, second.xyz, rtol=0, atol=0.51 * max(first.header.scales))
    exact = np.array_equal(first.header.scales, second.header.scales)
    assert set(first.point_format.dimension_names) == set(second.point_format.dimension_names)
    for name in set(first.point_format.dimension_names) - (set() if exact else set("XYZ")):
        np.testing.assert_array_equal(np.asarray(first[name]), np.asarray(second[name]), err_msg=name)
    assert first.header.parse_crs() == second.header.parse_crs()
    return len(first.points)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("point_format", [0, 1, 2, 3, 6, 7, 8])
def test_the_points_of_an_area_are_those_that_pdal_gives(tmp_path, las_file, point_format, suffix):
    version = "1.2" if point_format < 6 else "1.4"
    source = las_file(tmp_path / f"a{suffix}", point_format=point_format, version=version, change=every_value)
    count = clip(*open_cloud(source, METRES), AREA, tmp_path / "own.las")
    clipped_by_pdal(source, tmp_path / "pdal.las", AREA, METRES)
    assert same(tmp_path / "own.las", tmp_path / "pdal.las", flags_in_class=point_format < 6) == count
    before = laspy.read(source)
    expected = shapely.contains_xy(AREA, np.asarray(before.x), np.asarray(before.y))
    assert 0 < count < len(before.points)
    np.testing.assert_array_equal(np.asarray(laspy.read(tmp_path / "own.las").ids), np.asarray(before.ids)[expected])


def test_feet_become_metres_and_the_whole_cloud_is_kept_without_an_area(tmp_path, las_file):
    source = las_file(tmp_path / "a.las", crs="EPSG:6557", change=every_value)  # Oregon, in feet
    inputs = InputParameters(height_unit="us-survey-foot")
    clip(*open_cloud(source, inputs), None, tmp_path / "own.las")
    clipped_by_pdal(source, tmp_path / "pdal.las", None, inputs)
    assert same(tmp_path / "own.las", tmp_path / "pdal.las", flags_in_class=False) == 2000


def test_nothing_is_written_where_there_is_nothing(tmp_path, las_file):
    source = las_file(tmp_path / "a.las")
    assert clip(*open_cloud(source, METRES), shapely.Point(0, 0).buffer(5), tmp_path / "own.las") == 0
    assert not (tmp_path / "own.las").exists()


@pytest.mark.parametrize("name", ["real/lone-star.copc.laz", "terrain/santa_cruz_gullies.laz"])
def test_a_real_cloud(tmp_path, name):
    source = DATA / name
    if not source.is_file():
        pytest.skip(f"{name} is not next to the checkout")
    header, frame = open_cloud(source, InputParameters(crs="EPSG:32614" if "lone" in name else ""))
    low, high = np.array(header.bounds_low), np.array(header.bounds_high)
    middle = (low + high)[:2] / 2
    area = shapely.Point(middle).buffer(0.3 * float((high - low)[:2].min()))
    count = clip(header, frame, area, tmp_path / "own.las")
    any_pdal().run(clip_pipeline(source, tmp_path / "pdal.las", header, frame, area))
    assert 0 < same(tmp_path / "own.las", tmp_path / "pdal.las", flags_in_class=header.point_format < 6) == count
