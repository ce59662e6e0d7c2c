"""The pipelines' stages on real PDAL: what they keep, convert and crop, against numpy, shapely and laspy."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.geometry.dominant_plane import Plane
from slopewatch.engine.ground.pdal_pipelines import clip_pipeline, cloth_pipeline, matrix_text, select_pipeline
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.pdal_program import Pdal
from slopewatch.engine.pointcloud.reading import open_cloud
from slopewatch.interface.parameters import GroundParameters, InputParameters
from slopewatch.tests.builders.extracted_ground import any_pdal

FOOT = 0.3048


@pytest.fixture(scope="session")
def pdal() -> Pdal:
    return any_pdal()


def clip(pdal: Pdal, source: Path, output: Path, area=None, inputs: InputParameters | None = None) -> laspy.LasData:
    header, frame = open_cloud(source, inputs)
    pdal.run(clip_pipeline(source, output, header, frame, area))
    return laspy.read(output)


def test_a_crop_keeps_what_lies_in_the_polygons_and_not_in_their_holes(pdal, las_file, tmp_path):
    source = las_file(tmp_path / "in.laz", points=20_000)
    first = shapely.Point(500_008, 3_500_008).buffer(6).difference(shapely.box(500_006, 3_500_006, 500_009, 3_500_011))
    area = shapely.union_all([first, shapely.box(500_020, 3_500_002, 500_028, 3_500_018)])
    assert isinstance(area, shapely.MultiPolygon)
    found = clip(pdal, source, tmp_path / "out.laz", area)
    raw = laspy.read(source)
    points = shapely.points(raw.x, raw.y)
    inside = shapely.contains(area, points)
    decided = shapely.distance(shapely.boundary(area), points) > 0.002  # whom a border belongs to is open
    times = np.asarray(raw.gps_time)
    assert inside[decided].any()
    assert not inside[decided].all()
    assert set(times[inside & decided]) <= set(found.gps_time)
    assert not set(times[~inside & decided]) & set(found.gps_time)


@pytest.mark.parametrize(
    ("point_format", "version", "wanted"),
    [(0, "1.2", 6), (1, "1.2", 6), (2, "1.2", 7), (3, "1.2", 7), (6, "1.4", 6), (7, "1.4", 7), (8, "1.4", 8)],
)
def test_every_dimension_and_every_integer_is_kept(pdal, las_file, tmp_path, point_format, version, wanted):
    source = las_file(tmp_path / "in.las", point_format=point_format, version=version)
    found, raw = clip(pdal, source, tmp_path / "out.laz"), laspy.read(source)
    assert (found.header.point_format.id, str(found.header.version)) == (wanted, "1.4")
    assert np.array_equal(found.header.scales, raw.header.scales)
    assert np.array_equal(found.header.offsets, raw.header.offsets)
    for name in set(raw.point_format.dimension_names) & set(found.point_format.dimension_names):
        if name not in ("scan_angle", "scan_angle_rank"):
            assert np.array_equal(found[name], raw[name]), name
    assert preflight(tmp_path / "out.laz").compressed
    assert open_cloud(tmp_path / "out.laz")[1].crs.equals(CRS.from_epsg(32651), ignore_axis_order=True)


@pytest.mark.parametrize("odd_names", [False, True])
@pytest.mark.parametrize("version", ["1.2", "1.4"])
def test_extra_dimensions_are_kept(pdal, las_file, tmp_path, version, odd_names):
    def extra(las: laspy.LasData) -> None:
        las.add_extra_dims([laspy.ExtraBytesParams("quality", "u1"), laspy.ExtraBytesParams("Height_above", "f4")])
        if odd_names:
            las.add_extra_dims([laspy.ExtraBytesParams("3 words, odd", "u2"), laspy.ExtraBytesParams("pair", "2i2")])
            las["3 words, odd"] = np.arange(len(las.x)) % 60_000
        else:
            shift = laspy.ExtraBytesParams("shift", "i2", scales=np.array([0.01]), offsets=np.array([3.0]))
            las.add_extra_dims([shift])
            las.shift = np.random.default_rng(1).uniform(0, 5, len(las.x))
        rng = np.random.default_rng(0)
        las.quality, las.Height_above = rng.integers(0, 200, len(las.x)), rng.uniform(0, 9, len(las.x))

    source = las_file(tmp_path / "in.las", change=extra, version=version, point_format=3 if version == "1.2" else 7)
    found, raw = clip(pdal, source, tmp_path / "out.laz"), laspy.read(source)
    assert np.array_equal(found["quality"], raw["quality"])
    assert np.array_equal(found["Height_above"], raw["Height_above"])
    if odd_names:
        assert np.array_equal(found["X3_words__odd"], raw["3 words, odd"])
    else:
        assert np.allclose(found["shift"], np.asarray(raw["shift"]), atol=1e-9)


def test_feet_become_metres(pdal, las_file, tmp_path):
    source = las_file(tmp_path / "in.las", crs="EPSG:2222", scale=0.01)  # Arizona East, international feet
    # between two steps of the coordinates, so that no point lies on the border
    area = shapely.box(500_005.005 * FOOT, 3_500_004.005 * FOOT, 500_020.005 * FOOT, 3_500_016.005 * FOOT)
    found, raw = clip(pdal, source, tmp_path / "out.laz", area), laspy.read(source)
    xyz = np.array(raw.xyz)
    inside = (xyz[:, :2] > [500_005.005, 3_500_004.005]).all(1) & (xyz[:, :2] < [500_020.005, 3_500_016.005]).all(1)
    assert len(found.x) == inside.sum()
    assert np.allclose(found.xyz, xyz[inside] * FOOT, atol=1e-6)
    frame = open_cloud(tmp_path / "out.laz")[1]
    assert frame.in_metres
    assert "Arizona East" in frame.crs.name


def test_a_matrix_keeps_every_digit():
    matrix = np.random.default_rng(0).normal(0, 1e6, (4, 4)) / 3
    assert np.array_equal(np.array(matrix_text(matrix).split(), dtype=float).reshape(4, 4), matrix)


def test_a_selection_holds_the_ground(pdal, las_file, tmp_path):
    source = las_file(tmp_path / "in.laz")
    pdal.run(select_pipeline(source, tmp_path / "out.laz", preflight(source)))
    found, raw = laspy.read(tmp_path / "out.laz"), laspy.read(source)
    chosen = np.asarray(raw.classification) == 2
    assert np.array_equal(found.X, raw.X[chosen])
    assert (np.asarray(found.classification) == 2).all()


@pytest.mark.parametrize("aligned", [True, False])
def test_the_cloths_pipeline_is_valid(pdal, las_file, tmp_path, aligned):
    if pdal.path is None:
        pytest.skip("the pdal program is needed to validate a pipeline")
    source = las_file(tmp_path / "in.laz")
    plane = Plane(np.array([0.0, -0.6, 0.8]), np.array([5e5, 3.5e6, 60.0]), 1.0) if aligned else None
    header = preflight(source)
    stages = cloth_pipeline(source, tmp_path / "out.laz", header, GroundParameters(), 0.3, plane, last_returns=True)
    assert [s["type"] for s in stages].count("filters.transformation") == (2 if aligned else 0)
    result = subprocess.run(
        [pdal.path, "pipeline", "--validate", "--stdin"],
        input=json.dumps({"pipeline": stages}).encode(),
        capture_output=True,
    )
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["valid"] is True
    # an option that does not exist would be found
    stages[1 + aligned + 1]["type"], stages[1 + aligned + 1]["resolutoin"] = "filters.csf", 1
    result = subprocess.run(
        [pdal.path, "pipeline", "--validate", "--stdin"],
        input=json.dumps({"pipeline": stages}).encode(),
        capture_output=True,
    )
    assert b"resolutoin" in result.stdout + result.stderr
