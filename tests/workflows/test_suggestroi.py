"""A proposed region of a file, and what it is used for."""

from __future__ import annotations

import json

import laspy
import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.vector.area import read_roi
from slopewatch.interface.parameters import InputParameters, RegionParameters
from slopewatch.workflows.suggestroi import suggestroi_step

UTM = CRS.from_epsg(32651)


def write_cloud(path, *, crs=UTM):
    """A dense square of 20 x 20 m with a sparse rim of 5 m, and noise far away."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-5, 25, (22_500, 2))
    dense = ((xy > 0) & (xy < 20)).all(axis=1)
    xy = xy[dense | (rng.random(len(xy)) < 0.1)]
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(crs, keep_compatibility=False)
    las = laspy.LasData(header)
    las.x, las.y = np.append(500_000 + xy[:, 0], 500_900), np.append(3_500_000 + xy[:, 1], 3_500_900)
    las.z = np.full(len(xy) + 1, 50.0)
    las.classification = np.append(np.ones(len(xy)), 7).astype(np.uint8)
    las.write(path)
    return path


def propose(cloud, output, overwrite=False, **given):
    return suggestroi_step(
        cloud, output, RegionParameters(**given), InputParameters(), overwrite=overwrite, progress=Progress()
    )


def test_the_dense_part_becomes_a_region_that_other_commands_take(tmp_path):
    done = propose(write_cloud(tmp_path / "cloud 2025-05-01.laz"), tmp_path / "roi.gpkg")
    layer = pyogrio.read_dataframe(tmp_path / "roi.gpkg", layer="roi")
    assert list(layer.columns) == ["part", "area_m2", "density", "reason", "geometry"]
    truth = shapely.box(500_000, 3_500_000, 500_020, 3_500_020)
    found = layer.geometry[0]
    assert found.intersection(truth).area / found.union(truth).area > 0.85  # squares of 1 m
    assert found.difference(truth).area < 40
    assert done.figures["area_m2"] == pytest.approx(found.area, abs=0.01)
    assert done.figures["cloud_density"] == pytest.approx(25, rel=0.15)
    roi = read_roi(tmp_path / "roi.gpkg", UTM)
    assert roi.notes == ()
    assert roi.area == pytest.approx(found.area, abs=0.01)
    record = json.loads((tmp_path / "roi_run.json").read_text())
    assert record["command"] == "suggestroi"
    assert record["stages"][0]["noise_points"] == 1
    with pytest.raises(InputError, match="holds results already"):
        propose(tmp_path / "cloud 2025-05-01.laz", tmp_path / "roi.gpkg")
    before = (tmp_path / "roi.gpkg").read_bytes()
    propose(tmp_path / "cloud 2025-05-01.laz", tmp_path / "roi.gpkg", overwrite=True)
    assert (tmp_path / "roi.gpkg").read_bytes() == before


def test_refusals(tmp_path):
    cloud = write_cloud(tmp_path / "cloud.laz")
    for output, given, words in (
        ("roi.shp", {}, "end its name in .gpkg"),
        ("roi.gpkg", {"spike_width": 900.0}, "No region is left of"),
        ("gone/roi.gpkg", {}, "does not exist"),
    ):
        with pytest.raises(InputError, match=words):
            propose(cloud, tmp_path / output, **given)
    degrees = write_cloud(tmp_path / "degrees.laz", crs=CRS.from_epsg(4326))
    with pytest.raises(InputError, match="geographic"):
        propose(degrees, tmp_path / "roi.gpkg")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cloud.laz", "degrees.laz"]
