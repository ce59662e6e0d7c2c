"""What is kept near an area while a file is checked is clipped to the same points as the file itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from slopewatch.engine.ground.metrics import file_coverage
from slopewatch.engine.ground.pdal_pipelines import clip_pipeline
from slopewatch.engine.pointcloud.header import CloudHeader, preflight
from slopewatch.engine.pointcloud.near_area import NearArea, near_area
from slopewatch.engine.pointcloud.reading import open_cloud
from slopewatch.interface.parameters import InputParameters
from slopewatch.tests.builders.extracted_ground import any_pdal
from slopewatch.tests.engine.pointcloud.test_clipping import AREA, METRES, every_value

FEET = InputParameters(crs="EPSG:2277")  # Texas, US survey feet
FAR = shapely.box(0, 0, 10, 10)


def kept(path: Path, inputs: InputParameters, area: shapely.Geometry, output: Path) -> CloudHeader:
    header, frame = open_cloud(path, inputs)
    found = near_area(header, frame, area)
    assert isinstance(found, NearArea)
    alone, together = file_coverage(header, frame), file_coverage(header, frame, near=found)
    assert (alone.area, alone.bounds, alone.largest_class) == (together.area, together.bounds, together.largest_class)
    return found.written(output)


def points_of_clip(
    header: CloudHeader, path: Path, inputs: InputParameters, area: shapely.Geometry, out: Path
) -> bytes:
    frame = open_cloud(path, inputs)[1]
    any_pdal().run(clip_pipeline(header.path, out, header, frame, area))
    return out.read_bytes()[preflight(out).offset_to_points :]


@pytest.mark.parametrize("inputs", [METRES, FEET], ids=["metres", "feet"])
@pytest.mark.parametrize("point_format", [6, 7, 8])
def test_pdal_clips_both_to_the_same_bytes(tmp_path, las_file, point_format, inputs):
    path = las_file(tmp_path / "a.laz", point_format=point_format, version="1.4", change=every_value)
    area = AREA
    if inputs is FEET:
        factor = open_cloud(path, inputs)[1].horizontal_factor
        area = shapely.transform(AREA, lambda xy: xy * factor)
    near = kept(path, inputs, area, tmp_path / "near.las")
    whole = preflight(path)
    assert 0 < near.count < whole.count
    clips = [points_of_clip(h, path, inputs, area, tmp_path / f"{h.count}.las") for h in (near, whole)]
    assert len(clips[0]) > 100 * near.record_length
    assert clips[0] == clips[1]


def test_a_file_without_points_near_the_area_is_clipped_itself(tmp_path, las_file):
    path = las_file(tmp_path / "a.laz", point_format=6, version="1.4")
    assert kept(path, METRES, FAR, tmp_path / "near.las").path == path
    assert not (tmp_path / "near.las").exists()


@pytest.mark.parametrize(("name", "point_format", "version"), [("a.las", 6, "1.4"), ("a.laz", 3, "1.2")])
def test_files_that_are_read_as_fast_where_they_lie_are_left_there(tmp_path, las_file, name, point_format, version):
    path = las_file(tmp_path / name, point_format=point_format, version=version)
    assert near_area(*open_cloud(path, METRES), AREA) is None


def test_the_margin_keeps_what_lies_on_the_edge(tmp_path, las_file):
    path = las_file(tmp_path / "a.laz", point_format=6, version="1.4")
    point = np.array(preflight(path).bounds_low[:2]) + 5.0
    near = kept(path, METRES, shapely.box(*point, *(point + 8.0)), tmp_path / "near.las")
    assert (np.array(near.bounds_low[:2]) < point).all()
