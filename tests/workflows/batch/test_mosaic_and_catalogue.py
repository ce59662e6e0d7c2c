"""The mosaic as GDAL reads it, and the catalogue of clouds as STAC's own library does."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from pyproj import CRS, Transformer
from slopewatch.engine.grid.geotiff import write_raster
from slopewatch.engine.grid.grid import Grid
from slopewatch.tests.builders.clouds import LasFile, las_file
from slopewatch.workflows.batch.catalogue import MadeCloud, item_collection
from slopewatch.workflows.batch.mosaic import mosaic, read_tile

__all__ = ["las_file"]
UTM = CRS.from_epsg(32651)


def raster(path: Path, west: float, north: float, cell: float, array: np.ndarray, crs: CRS = UTM) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_raster(path, array, Grid(west, north, cell, *array.shape), crs, description="Elevation change")
    return path


def test_rasters_of_several_cells_are_one(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    fine, coarse = rng.normal(size=(6, 8)), rng.normal(size=(3, 2))
    fine[2, 3] = np.nan
    tiles = [
        read_tile(raster(tmp_path / "slopes/a & <b>/x.tif", 500_000.0, 3_500_010.0, 0.5, fine)),
        read_tile(raster(tmp_path / "slopes/c/x.tif", 500_010.0, 3_500_008.0, 1.0, coarse)),
        read_tile(raster(tmp_path / "slopes/d/x.tif", 500_000.0, 50.0, 1.0, coarse, CRS.from_epsg(32652))),
    ]
    text, left_out = mosaic(tiles, tmp_path)
    assert left_out == (tiles[2].path,)
    assert str(tmp_path) not in text, "it can be moved with its slopes"
    (tmp_path / "all.vrt").write_text(text, encoding="utf-8")
    with rasterio.open(tmp_path / "all.vrt") as source:
        assert (source.res, source.nodata, source.crs.to_epsg()) == ((0.5, 0.5), -9999, 32651)
        assert source.bounds == (500_000.0, 3_500_005.0, 500_012.0, 3_500_010.0)
        seen = source.read(1, masked=True).filled(np.nan)
    assert np.array_equal(seen[:6, :8], fine.astype(np.float32), equal_nan=True)
    assert np.array_equal(seen[4:10, 20:24], np.kron(coarse, np.ones((2, 2))).astype(np.float32))
    assert np.isfinite(seen).sum() == 6 * 8 - 1 + 3 * 2 * 4


def test_a_gap_of_one_raster_does_not_hide_another(tmp_path: Path) -> None:
    holes = np.full((4, 4), np.nan)
    holes[0, 0] = 2.0
    tiles = [
        read_tile(raster(tmp_path / "a.tif", 500_000.0, 4.0, 1.0, np.ones((4, 4)))),
        read_tile(raster(tmp_path / "b.tif", 500_000.0, 4.0, 1.0, holes)),
    ]
    (tmp_path / "all.vrt").write_text(mosaic(tiles, tmp_path)[0], encoding="utf-8")
    with rasterio.open(tmp_path / "all.vrt") as source:
        seen = source.read(1)
    assert seen[0, 0] == 2.0
    assert (seen.ravel()[1:] == 1.0).all()


@pytest.fixture
def catalogue(las_file: LasFile, tmp_path: Path) -> tuple[Path, list[str]]:
    (tmp_path / "slopes" / "A 1").mkdir(parents=True)
    clouds = [
        MadeCloud("A 1", las_file(tmp_path / "slopes" / "A 1" / "é#1.laz", points=5000), "2024-05-01", "ground"),
        MadeCloud("=B", las_file(tmp_path / "b.las", points=3000, seed=1), "2025-05-01", "aligned ground"),
        MadeCloud("C", las_file(tmp_path / "c.laz", crs=None), "2025-05-01", "ground"),
    ]
    document, notes = item_collection(clouds, tmp_path)
    path = tmp_path / "clouds.vpc"
    path.write_text(json.dumps(document, allow_nan=False), encoding="utf-8")
    return path, notes


def test_the_catalogue_says_of_each_cloud_what_laspy_says(catalogue: tuple[Path, list[str]]) -> None:
    path, notes = catalogue
    assert notes == ["c.laz of C has no reference system or extent, so no catalogue."]
    document = json.loads(path.read_text(encoding="utf-8"))
    assert len(document["features"]) == 2
    to_degrees = Transformer.from_crs(UTM, 4326, always_xy=True)
    for item, name in zip(document["features"], ("slopes/A 1/é#1.laz", "b.las"), strict=True):
        header = laspy.open(path.parent / name).header
        properties = item["properties"]
        assert properties["pc:count"] == header.point_count
        assert properties["proj:bbox"] == pytest.approx([*header.mins, *header.maxs])
        assert CRS.from_wkt(properties["proj:wkt2"]) == UTM
        corners = np.array(item["geometry"]["coordinates"][0])
        x, y = to_degrees.transform([header.mins[0], header.maxs[0]], [header.mins[1], header.maxs[1]])
        assert corners[:, 0].min() == pytest.approx(min(x), abs=1e-6)
        assert corners[:, 1].max() == pytest.approx(max(y), abs=1e-6)
        assert {s["name"] for s in properties["pc:schemas"]} >= {"X", "Y", "Z", "classification", "gps_time"}
    assert document["features"][0]["assets"]["data"]["href"] == "./slopes/A%201/%C3%A9%231.laz"


def test_it_is_stac_by_its_own_library(catalogue: tuple[Path, list[str]]) -> None:
    pystac = pytest.importorskip("pystac", reason="pystac is not installed")
    from pystac.extensions.pointcloud import PointcloudExtension

    items = pystac.ItemCollection.from_file(str(catalogue[0])).items
    assert [item.id for item in items] == ["A 1 2024-05-01 ground", "=B 2025-05-01 aligned ground"]
    for item in items:
        cloud = PointcloudExtension.ext(item)
        assert cloud.type == "lidar"
        assert cloud.schemas[0].properties == {"name": "X", "size": 8, "type": "floating"}
        assert item.datetime.isoformat() in ("2024-05-01T00:00:00+00:00", "2025-05-01T00:00:00+00:00")
        assert item.bbox[0] < item.bbox[3]
        # what the schemas of the extensions ask for (pointcloud 1.0, projection 1.1), which are not at hand offline
        assert {"pc:count", "pc:type", "pc:encoding", "pc:schemas"} <= item.properties.keys()
        assert {s.properties["type"] for s in cloud.schemas} <= {"floating", "unsigned", "signed"}
        assert all(isinstance(s.properties["size"], int) for s in cloud.schemas)
        assert len(item.properties["proj:bbox"]) == 6
        item.stac_extensions = []
        assert item.validate(), "the schema of an item, which pystac holds"
