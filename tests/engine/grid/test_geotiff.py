"""Rasters read back by GDAL without SlopeWatch's own reader."""

from __future__ import annotations

import hashlib
from datetime import date
from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.core.version import VERSION
from slopewatch.engine.grid import geotiff
from slopewatch.engine.grid.geotiff import raster_tags, read_raster, write_raster, write_rgba
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.statistics.layout import Laid, Layout

GRID = Grid(west=500000.4, north=4000012.6, cell=0.2, rows=30, columns=45)
UTM = CRS("EPSG:32651")
GEOREFERENCE = {"transform": rasterio.Affine(1, 0, 5, 0, -1, 5)}


def surface() -> np.ndarray:
    array = np.random.default_rng(1).normal(size=GRID.shape)
    array[:4, :9] = np.nan
    return array


def test_raster_is_what_the_contract_says(tmp_path: Path) -> None:
    path = tmp_path / "elevation_change.tif"
    array = surface()
    tags = raster_tags(
        epochs=(date(2024, 1, 2), date(2024, 4, 5)),
        median_level=0.0567,
        translation=(0.1, -0.02, 0.003),
        software=f"SlopeWatch {VERSION}",
        input_sha256="aa bb",
    )
    write_raster(path, array, GRID, UTM, description="Elevation change", tags=tags)
    assert [p.name for p in tmp_path.iterdir()] == ["elevation_change.tif"]
    with rasterio.open(path) as source:
        band = source.read(1)
        assert source.dtypes == ("float32",)
        assert source.nodata == -9999.0
        assert not np.isnan(band).any()
        assert np.array_equal(band == -9999.0, np.isnan(array))
        assert np.array_equal(band[~np.isnan(array)], array[~np.isnan(array)].astype(np.float32))
        assert tuple(source.transform)[:6] == pytest.approx((0.2, 0, 500000.4, 0, -0.2, 4000012.6))
        assert source.crs.to_epsg() == 32651
        assert source.descriptions == ("Elevation change",)
        assert source.units == ("m",)
        structure = source.tags(ns="IMAGE_STRUCTURE")
        assert (structure["COMPRESSION"], structure["PREDICTOR"], structure["LAYOUT"]) == ("DEFLATE", "3", "COG")
        written = source.tags()
    assert {k: written[k] for k in tags} == {
        "EPOCH_FROM": "2024-01-02",
        "EPOCH_TO": "2024-04-05",
        "LOD95_MEDIAN": "0.056700",
        "COREG_DX": "0.100000",
        "COREG_DY": "-0.020000",
        "COREG_DZ": "0.003000",
        "SOFTWARE": f"SlopeWatch {VERSION}",
        "INPUT_SHA256": "aa bb",
    }


def test_a_point_lands_in_its_own_cell(tmp_path: Path) -> None:
    array = np.zeros(GRID.shape)
    array[7, 11] = 5.0
    write_raster(tmp_path / "a.tif", array, GRID, UTM, description="")
    with rasterio.open(tmp_path / "a.tif") as source:
        # centre of row 7, column 11, by hand
        (value,) = next(source.sample([(500000.4 + 11.5 * 0.2, 4000012.6 - 7.5 * 0.2)]))
        assert value == 5.0


def test_same_content_same_bytes(tmp_path: Path) -> None:
    digests = set()
    for name in ("a.tif", "b.tif"):
        write_raster(tmp_path / name, surface(), GRID, UTM, description="x", tags={"SOFTWARE": "s"})
        digests.add(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert len(digests) == 1


def test_round_trip_with_vertical_system(tmp_path: Path) -> None:
    compound = CRS("EPSG:32651+5773")
    write_raster(tmp_path / "a.tif", surface(), GRID, compound, description="dz", tags={"EPOCH_TO": "2024-04-05"})
    back = read_raster(tmp_path / "a.tif")
    assert np.array_equal(back.array, surface().astype(np.float32), equal_nan=True)
    assert back.grid.shape == GRID.shape
    assert back.grid.bounds == pytest.approx(GRID.bounds)
    assert back.crs is not None
    assert [part.to_epsg() for part in back.crs.sub_crs_list] == [32651, 5773]
    assert (back.description, back.unit, back.tags) == ("dz", "m", {"EPOCH_TO": "2024-04-05"})


def test_large_rasters_have_overviews_that_ignore_nodata(tmp_path: Path) -> None:
    grid = Grid(west=0.0, north=600.0, cell=1.0, rows=600, columns=700)
    array = np.full(grid.shape, 2.0)
    array[:, ::2] = np.nan
    write_raster(tmp_path / "a.tif", array, grid, UTM, description="")
    with rasterio.open(tmp_path / "a.tif") as source:
        assert source.overviews(1)
        assert np.array_equal(np.unique(source.read(1, out_shape=(300, 350))), [2.0])


def test_unknown_tags_are_left_out() -> None:
    assert raster_tags(software="s", median_level=float("nan")) == {"SOFTWARE": "s"}


@pytest.mark.parametrize(
    "array",
    [np.zeros((3, 4)), np.where(np.arange(30 * 45).reshape(30, 45) == 7, np.inf, 0.0)],
    ids=["shape", "infinite"],
)
def test_what_is_no_raster_of_the_grid_is_refused(tmp_path: Path, array: np.ndarray) -> None:
    with pytest.raises(EngineError, match=r"a\.tif"):
        write_raster(tmp_path / "a.tif", array, GRID, UTM, description="")
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_left_when_the_file_does_not_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def copy_another(source: object, target: Path, **options: object) -> None:
        with rasterio.open(
            target, "w", driver="GTiff", width=2, height=2, count=1, dtype="float32", **GEOREFERENCE
        ) as broken:
            broken.write(np.zeros((1, 2, 2), dtype=np.float32))

    monkeypatch.setattr(geotiff.rasterio.shutil, "copy", copy_another)
    with pytest.raises(EngineError, match="differs"):
        write_raster(tmp_path / "a.tif", surface(), GRID, UTM, description="")
    assert list(tmp_path.iterdir()) == []


def test_missing_folder_is_the_users_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        write_raster(tmp_path / "none" / "a.tif", surface(), GRID, UTM, description="")


def test_picture_has_colours_and_transparency(tmp_path: Path) -> None:
    rgba = np.random.default_rng(2).integers(0, 256, (*GRID.shape, 4)).astype(np.uint8)
    write_rgba(tmp_path / "a.tif", rgba, GRID, UTM, tags={"SOFTWARE": "s"})
    with rasterio.open(tmp_path / "a.tif") as source:
        assert [c.name for c in source.colorinterp] == ["red", "green", "blue", "alpha"]
        assert np.array_equal(np.moveaxis(source.read(), 0, -1), rgba)
        assert source.crs.to_epsg() == 32651
        assert source.tags()["SOFTWARE"] == "s"
    with pytest.raises(EngineError, match="does not fit"):
        write_rgba(tmp_path / "b.tif", rgba[:-1], GRID, UTM)


def test_reading_what_is_no_raster(tmp_path: Path) -> None:
    (tmp_path / "a.tif").write_text("not a raster")
    with pytest.raises(InputError, match="is not a GeoTIFF"):
        read_raster(tmp_path / "a.tif")
    with rasterio.open(
        tmp_path / "oblong.tif", "w", driver="GTiff", width=2, height=2, count=1, dtype="float32",
        transform=rasterio.Affine(1, 0, 0, 0, -2, 0),
    ):  # fmt: skip
        pass
    with pytest.raises(InputError, match="square cells"):
        read_raster(tmp_path / "oblong.tif")


def test_a_list_of_cells_makes_the_file_of_the_whole_array(tmp_path: Path) -> None:
    """Of a raster of several rows of tiles, most of which hold nothing."""
    grid = Grid(west=500000.0, north=4000000.0, cell=0.5, rows=600, columns=1100)
    row = np.repeat(np.arange(grid.rows), 40)
    column = (row * 1.2).astype(int) % (grid.columns - 40) + np.tile(np.arange(40), grid.rows)
    listed = Layout(grid.shape, np.unique(row * grid.columns + column))
    values = np.random.default_rng(2).normal(size=listed.array_shape)
    counts = np.arange(values.size) % 9
    for name, held in (("heights", values), ("counts", counts)):
        write_raster(tmp_path / "listed.tif", Laid(held, listed), grid, UTM, description=name)
        write_raster(tmp_path / "whole.tif", listed.on_grid(held), grid, UTM, description=name)
        assert (tmp_path / "listed.tif").read_bytes() == (tmp_path / "whole.tif").read_bytes()
        with rasterio.open(tmp_path / "listed.tif") as found:
            expected = np.zeros(grid.shape) if name == "counts" else np.full(grid.shape, geotiff.NODATA)
            expected.ravel()[listed.listed] = held
            assert np.array_equal(found.read(1), expected.astype(np.float32))
    with pytest.raises(EngineError, match="does not fit"):
        write_raster(tmp_path / "listed.tif", Laid(values[1:], listed), grid, UTM, description="one too few")
