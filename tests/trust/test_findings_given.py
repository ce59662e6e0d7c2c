"""What fuzzing found of files given next to clouds and of results that are read again, as small as shows it."""

from __future__ import annotations

import contextlib
import csv
import json
import sqlite3
import struct
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pandas as pd
import pyogrio
import pytest
import rasterio
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.elevation_models.model import read_model
from slopewatch.engine.flight.flown_tracks import track_from_angles
from slopewatch.engine.flight.terrain import terrain_of_model
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.handover.held import read_held, read_record, read_sections
from slopewatch.engine.handover.tables import copy_table
from slopewatch.engine.maps.label_pngs import PictureSource
from slopewatch.engine.pointcloud.times import read_flown
from slopewatch.engine.road.centreline import read_roads
from slopewatch.engine.vector.geopackage import Layer, write_layers
from slopewatch.engine.zones.profile_lines import given_lines
from slopewatch.lab.fuzz.readers import RECORD
from slopewatch.lab.fuzz.targets_given import flown
from slopewatch.tests.builders.elevation_models import write_model
from slopewatch.workflows.compareflight import read_promised
from slopewatch.workflows.planflight import read_tracks


def test_times_that_no_survey_has(tmp_path: Path) -> None:
    """One of 1e300 s made a list of every half second until then."""
    path = flown(tmp_path / "flown.las")
    las = laspy.read(path)
    las.gps_time[5] = 1e300
    las.write(path)
    assert read_flown(path).seconds is None
    las.gps_time[5] = 1e11
    las.write(path)
    seen = read_flown(path)
    assert seen.seconds is not None
    one = las.point_source_id == 1
    track = track_from_angles(np.asarray(las.xyz)[one], seen.seconds[one], seen.angle[one])
    assert track is None or len(track.seconds) < one.sum()


def test_a_plan_without_shapes(tmp_path: Path) -> None:
    path = tmp_path / "plan.gpkg"
    values = {"line": [1], "returns_m2": [1.0], "ground_m2": [1.0]}
    line, square = shapely.LineString([(0, 0, 9), (9, 0, 9)]), shapely.box(0, 0, 5, 5)
    far = shapely.box(1e12, 0, 1e12 + 5, 5)
    cases = [
        ({"lines": [line], "places": [None]}, "no flight lines with places"),
        ({"lines": [None], "places": [square]}, "no flight lines with places"),
        ({"lines": [line] * 2, "places": [square, far]}, "places without a shape or too far apart"),
    ]
    for layers, words in cases:
        path.unlink(missing_ok=True)
        for name, shapes in layers.items():
            table = {key: value * len(shapes) for key, value in values.items()}
            geopandas.GeoDataFrame(table, geometry=shapes, crs=32651).to_file(path, layer=name)
        with pytest.raises(InputError, match=words):
            read_promised(path)
    for name in ("lines", "places"):  # tables without a column of shapes
        pyogrio.write_dataframe(pd.DataFrame(values), path, layer=name, append=name == "places")
    with pytest.raises(InputError, match="no flight lines with places"):
        read_promised(path)


def test_a_line_of_one_corner(tmp_path: Path) -> None:
    geometry = {"type": "LineString", "coordinates": [[500_000.0, 3_500_000.0]]}
    feature = {"type": "Feature", "properties": {}, "geometry": geometry}
    path = tmp_path / "road.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}), encoding="utf-8")
    with pytest.raises(InputError, match=r"road\.geojson"):
        read_roads(path, CRS("EPSG:32651"))
    with pytest.raises(InputError, match=r"road\.geojson"):
        given_lines(path, CRS("EPSG:32651"), "name", Progress())


def test_an_elevation_model_with_a_signalling_value(tmp_path: Path) -> None:
    path = write_model(tmp_path / "dem.tif", np.full((4, 4), 7.25))
    signalling = struct.pack("<I", 0x7FA00000)
    data = path.read_bytes()
    place = data.index(struct.pack("<f", 7.25) * 2)
    path.write_bytes(data[:place] + signalling + data[place + 4 :])
    assert read_model(path).holes == 1  # warnings are errors here
    assert np.isnan(read_raster(path).array.astype(np.float64)).sum() == 1


def test_a_picture_whose_pixels_are_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "top_view.tif"
    place = rasterio.Affine(1, 0, 5e5, 0, -1, 3.5e6)
    profile = {"count": 3, "dtype": "uint8", "height": 64, "width": 64, "crs": "EPSG:32651", "compress": "deflate"}
    with rasterio.open(path, "w", driver="GTiff", transform=place, **profile) as target:
        target.write(np.random.default_rng(1).integers(0, 255, (3, 64, 64), dtype=np.uint8))
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"top_view\.tif' cannot be read as a raster"), PictureSource(path) as source:
        list(source.tiles(100))


@pytest.mark.parametrize("started", ["nan2026-11-23", "", "2026-02-30T00:00:00+00:00"])
def test_a_run_that_began_on_no_day(tmp_path: Path, started: str) -> None:
    path = tmp_path / "run.json"
    path.write_text(json.dumps(RECORD | {"started": started}), encoding="utf-8")
    with pytest.raises(InputError, match="started is not a date"):
        read_record(path)


def test_a_style_that_is_no_xml(tmp_path: Path) -> None:
    path = tmp_path / "zones.gpkg"
    frame = geopandas.GeoDataFrame({"a": [1]}, geometry=[shapely.box(0, 0, 1, 1)], crs=32651)
    write_layers(path, [Layer(frame, "zones", "<qgis/>")])
    record = {"command": "change", "outputs": {"zones": "zones.gpkg"}}
    (tmp_path / "run.json").write_text(json.dumps(record), encoding="utf-8")
    assert read_held(tmp_path).layers[0].qml == "<qgis/>"
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        base.execute("UPDATE layer_styles SET styleQML = '<qgis>\x01'")
    with pytest.raises(InputError, match=r"zones\.gpkg' holds a style that cannot be read"):
        read_held(tmp_path)


def test_a_table_handed_over_has_no_cell_that_is_no_number(tmp_path: Path) -> None:
    """A profile's height that somebody entered as nan was handed over as such."""
    source, target = tmp_path / "profiles.csv", tmp_path / "out.csv"
    source.write_bytes(b'profile,height_m\r\n"A, the nan",nan\r\nB,-Inf\r\nC,1.5\r\n')
    copy_table(source, target)
    assert list(csv.reader(target.open(encoding="utf-8", newline=""))) == [
        ["profile", "height_m"],
        ["A, the nan", ""],
        ["B", ""],
        ["C", "1.5"],
    ]
    source.write_bytes(b'profile,height_m\r\n"A",1.0\r\n')
    copy_table(source, target)
    assert target.read_bytes() == source.read_bytes()


def test_a_section_with_a_place_that_is_no_number(tmp_path: Path) -> None:
    path = tmp_path / "profiles.csv"
    rows = ["0,5e5,3.3e6,1,1", "1,5e5,-inf,1,1", "2,5e5,3.3e6,1,1"]
    path.write_text("\n".join(["profile,distance_m,x,y,height_from_m,height_to_m", *(f"A,{r}" for r in rows)]))
    with pytest.raises(InputError, match=r"profiles\.csv' is no table of profiles \(a place of A is no number\)"):
        read_sections(path)


def test_a_raster_beyond_the_earth(tmp_path: Path) -> None:
    """Its height in metres was lost in the digits, and the report divided by it."""
    path = tmp_path / "far.tif"
    far = {"driver": "GTiff", "count": 1, "dtype": "float32", "height": 4, "width": 4, "crs": "EPSG:32651"}
    with rasterio.open(path, "w", transform=rasterio.Affine(2, 0, 1.7e45, 0, -2, 1.6e98), **far) as raster:
        raster.write(np.ones((1, 4, 4), dtype=np.float32))
    with pytest.raises(InputError, match=r"far\.tif has a corner at 1\.7e\+45"):
        read_raster(path)


def test_a_plan_with_a_line_that_leaves_the_terrain(tmp_path: Path) -> None:
    """A corner far away made a place each metre until there, and the refusal named the terrain alone."""
    model = read_model(write_model(tmp_path / "terrain.tif", np.zeros((40, 40))))
    west, north, side = model.grid.west, model.grid.north, model.grid.cell * 40
    for name, end in (("near", north - side / 2), ("far", north - 1e9)):
        line = shapely.LineString([(west + side / 2, north - side / 4), (west + side / 2, end)])
        frame = geopandas.GeoDataFrame({"line": [1]}, geometry=[line], crs=model.crs)
        frame.to_file(tmp_path / f"{name}.gpkg", layer="lines")
    terrain = terrain_of_model(model, 0.0)
    assert len(read_tracks(tmp_path / "near.gpkg", terrain)) == 1
    with pytest.raises(InputError, match=r"plan '.*far\.gpkg' leaves the terrain '.*terrain\.tif'"):
        read_tracks(tmp_path / "far.gpkg", terrain)
