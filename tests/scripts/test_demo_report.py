"""The demo's figures, on small maps whose error is known."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
from shapely import box

CELL = 0.5
LEFT, TOP = 500000.0, 3500020.0
BIAS = 0.004


@pytest.fixture(scope="module")
def report(root):
    spec = importlib.util.spec_from_file_location("demo_report", root / "scripts" / "demo_report.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["demo_report"] = module
    spec.loader.exec_module(module)
    return module


def write_raster(path: Path, values: np.ndarray, left: float, top: float) -> None:
    transform = rasterio.transform.from_origin(left, top, CELL, CELL)
    height, width = values.shape
    profile = {"driver": "GTiff", "height": height, "width": width, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", crs="EPSG:32651", transform=transform, nodata=-9999, **profile) as raster:
        raster.write(np.where(np.isnan(values), -9999, values).astype("float32"), 1)


@pytest.fixture
def run(tmp_path: Path) -> tuple[Path, Path]:
    """A survey with one raised and one lowered rectangle; results on a smaller grid, 4 mm too high everywhere."""
    survey, results = tmp_path / "survey", tmp_path / "results"
    (results / "clouds").mkdir(parents=True)
    survey.mkdir()
    truth = np.zeros((40, 40))
    truth[10:14, 10:14] = 0.2
    truth[20:22, 20:24] = -0.1
    write_raster(survey / "truth_dz.tif", truth, LEFT, TOP)
    found = truth[5:35, 5:35] + BIAS
    found[0, :] = np.nan
    write_raster(results / "elevation_change.tif", found, LEFT + 5 * CELL, TOP - 5 * CELL)

    matrix = np.eye(4)
    (survey / "truth_transform.json").write_text(json.dumps({"matrix": matrix.tolist()}), encoding="utf-8")
    matrix[:3, 3] = [0.003, 0.0, 0.004]
    (results / "transform.json").write_text(json.dumps({"matrix": matrix.tolist()}), encoding="utf-8")
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.offsets, header.scales = [LEFT, TOP, 0], [0.001] * 3
    cloud = laspy.LasData(header)
    cloud.xyz = np.random.default_rng(1).uniform(0, 10, (200, 3)) + [LEFT, TOP, 0]
    cloud.write(results / "clouds" / "2025-05-01_ground.laz")

    (survey / "truth.json").write_text(json.dumps({"changes": [{}, {}]}), encoding="utf-8")
    raised = box(LEFT + 10 * CELL, TOP - 14 * CELL, LEFT + 14 * CELL, TOP - 10 * CELL)
    zones = {"kind": ["uplift"], "geometry": [raised]}
    geopandas.GeoDataFrame(zones, crs="EPSG:32651").to_file(results / "zones.gpkg", layer="zones")
    around = {"vol_net_m3": [0.85], "geometry": [raised.buffer(2 * CELL, join_style="mitre")]}
    geopandas.GeoDataFrame(around, crs="EPSG:32651").to_file(results / "zones.gpkg", layer="footprints")
    volumes = {"vol_gain_m3": 0.85, "vol_gain_err_m3": 0.05, "vol_loss_m3": 0.0, "vol_loss_err_m3": 0.0}
    (results / "run.json").write_text(json.dumps({"metrics": volumes}), encoding="utf-8")
    return survey, results


def cells(rows, name: str) -> tuple[str, str]:
    return next((true, found) for label, true, found in rows if label.startswith(name))


def test_change_is_compared_on_the_same_cells_of_both_grids(report, run):
    maps = report.read_maps(*run)
    assert maps.found.shape == (30, 30)
    np.testing.assert_allclose((maps.found - maps.truth)[1:], BIAS, atol=1e-6)
    assert not maps.measured[0].any()
    rows = report.change_rows(maps)
    assert cells(rows, "mean change of unchanged") == ("0 mm", "+4.0 mm")
    assert cells(rows, "scatter of unchanged") == ("0 mm", "0.0 mm")
    assert cells(rows, "mean change of cells raised") == ("+0.200 m", "+0.204 m")
    assert cells(rows, "mean change of cells lowered") == ("-0.100 m", "-0.096 m")


def test_registration_is_the_distance_between_true_and_found_places(report, run):
    rows = report.registration_rows(*run)
    assert cells(rows, "left after registration") == ("0 mm", "5.00 mm")


def test_volumes_are_those_of_the_zones_footprints(report, run):
    rows = report.zone_rows(*run, report.read_maps(*run))
    assert cells(rows, "hazard zones") == ("2 changes", "1 zones")
    assert cells(rows, "volume raised") == ("0.80 m3", "0.85 m3 (+- 0.05)")
    assert cells(rows, "volume lowered")[0].lstrip("-") == "0.00 m3"
    assert cells(rows, "cells changed")[1] == "67 %", "16 of 24 changed cells"


def test_screened_zones_are_counted_by_what_truly_moved(report, run):
    survey, results = run
    maps = report.read_maps(survey, results)
    assert report.screening_rows(results, maps) == []

    def cells_of(row: int, column: int, rows: int, columns: int):
        return box(LEFT + column * CELL, TOP - (row + rows) * CELL, LEFT + (column + columns) * CELL, TOP - row * CELL)

    raised, lowered, still = cells_of(10, 10, 4, 4), cells_of(20, 20, 2, 4), cells_of(30, 10, 3, 3)
    zones = {
        "kind": ["uplift", "subsidence", "subsidence", "uplift"],
        "confirmed": ["confirmed", "not confirmed", "confirmed", "not measured"],
        "geometry": [raised, lowered, still, cells_of(10, 10, 4, 30)],
    }
    geopandas.GeoDataFrame(zones, crs="EPSG:32651").to_file(results / "screened_zones.gpkg", layer="zones")
    rows = report.screening_rows(results, maps)
    assert cells(rows, "screened zones") == ("", "4 zones")
    assert cells(rows, "screened zones that moved") == ("2", "1 confirmed")
    assert cells(rows, "other screened zones") == ("2", "1 confirmed")


@pytest.mark.parametrize(
    ("pdal", "said"), [({"version": "2.9.1"}, "PDAL 2.9.1"), ({"version": "", "instead": "laspy and shapely"}, "laspy")]
)
def test_the_demo_says_what_read_the_clouds(report, run, pdal, said):
    survey, results = run
    metrics = {"reference_vegetation_cover": 0.5, "common_cell_rate": 0.9, "lod_median_m": 0.03}
    (survey / "truth.json").write_text(json.dumps({"vegetation_cover_of_slope": 0.5}), encoding="utf-8")
    record = {"metrics": metrics, "pdal": pdal, "seconds": 1.0}
    (results / "run.json").write_text(json.dumps(record), encoding="utf-8")
    assert cells(report.run_rows(survey, results), "clouds read and clipped by")[1].startswith(said)
