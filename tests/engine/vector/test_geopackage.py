"""GeoPackages read back through sqlite and GDAL."""

from __future__ import annotations

import hashlib
import sqlite3
from contextlib import closing
from datetime import date
from pathlib import Path
from xml.etree import ElementTree

import geopandas as gpd
import numpy as np
import pyogrio
import pytest
from pyproj import CRS
from shapely.geometry import box
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.vector import geopackage
from slopewatch.engine.vector.geopackage import read_layer, write_layer
from slopewatch.engine.zones.fields import FIELDS
from slopewatch.interface.parameters import ZoneParameters
from slopewatch.tests.builders.change_zones import zones_of
from slopewatch.workflows.products.zones import write_zones


def zones(height: float = 0.4, epochs: tuple[date | None, date | None] = (None, None)) -> gpd.GeoDataFrame:
    dz = np.zeros((20, 20))
    dz[2:8, 2:8] = height
    dz[12:18, 4:15] = -height / 2
    level = np.full(dz.shape, 0.1)
    grid = Grid(west=500000.0, north=4000010.0, cell=0.5, rows=20, columns=20)
    significant = np.abs(dz) > level
    count = np.full(dz.shape, 4)
    return zones_of(dz, significant, level, level / 2, count, grid, CRS(32651), ZoneParameters(), epochs=epochs).frame


def query(path: Path, sql: str) -> list[tuple]:
    with closing(sqlite3.connect(path)) as database:
        return database.execute(sql).fetchall()


def test_zones_survive_the_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "zones.gpkg"
    frame = zones(epochs=(date(2024, 1, 1), date(2024, 4, 1)))
    write_zones(path, frame, stamp=date(2024, 4, 1))
    assert [p.name for p in tmp_path.iterdir()] == ["zones.gpkg"]
    back = pyogrio.read_dataframe(path, layer="zones")
    assert list(back.columns) == [*FIELDS, "geometry"]
    assert back.crs.to_epsg() == 32651
    assert back.geometry.geom_equals(frame.geometry).all()
    for name, kind in FIELDS.items():
        if kind == "text":
            assert back[name].tolist() == frame[name].tolist()
        else:
            assert back[name].to_numpy(float) == pytest.approx(frame[name].to_numpy(float), nan_ok=True)


def test_unknown_numbers_are_null_and_unknown_texts_empty(tmp_path: Path) -> None:
    write_zones(tmp_path / "zones.gpkg", zones())
    columns = "days, rate_mm_day, chain_from, slope_deg, epoch_from, route, typeof(n_cells), typeof(area_m2)"
    assert (
        query(tmp_path / "zones.gpkg", f"SELECT {columns} FROM zones")
        == [(None, None, None, None, "", "", "integer", "real")] * 2
    )


def test_the_style_is_inside_and_the_default(tmp_path: Path) -> None:
    path = tmp_path / "zones.gpkg"
    write_zones(path, zones())
    ((table, column, default, qml),) = query(
        path, "SELECT f_table_name, f_geometry_column, useAsDefault, styleQML FROM layer_styles"
    )
    assert (table, default) == ("zones", 1)
    assert query(path, "SELECT column_name FROM gpkg_geometry_columns") == [(column,)]
    assert ElementTree.fromstring(qml).tag == "qgis"
    assert [name for name, _ in pyogrio.list_layers(path)] == ["zones", "layer_styles"]
    assert query(path, "SELECT table_name, data_type FROM gpkg_contents ORDER BY table_name") == [
        ("layer_styles", "attributes"),
        ("zones", "features"),
    ]


def test_no_zone_is_still_a_styled_layer(tmp_path: Path) -> None:
    path = tmp_path / "zones.gpkg"
    write_zones(path, zones(0.01))
    info = pyogrio.read_info(path, layer="zones")
    assert info["features"] == 0
    assert info["geometry_type"] == "MultiPolygon"
    assert list(info["fields"]) == list(FIELDS)
    assert query(path, "SELECT count(*) FROM layer_styles") == [(1,)]


def test_same_content_same_bytes_whatever_the_clock(tmp_path: Path) -> None:
    digests = set()
    for name in ("a.gpkg", "b.gpkg"):
        write_zones(tmp_path / name, zones(), stamp=date(2024, 4, 1))
        digests.add(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert len(digests) == 1
    # as many changes as the timing of the writer's transactions made, it always says one
    header = (tmp_path / "a.gpkg").read_bytes()[:100]
    assert header[24:28] == header[92:96] == (1).to_bytes(4, "big")
    stamps = query(
        tmp_path / "a.gpkg", "SELECT last_change FROM gpkg_contents UNION SELECT update_time FROM layer_styles"
    )
    assert stamps == [("2024-04-01T00:00:00.000Z",)]


def test_an_older_file_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    write_layer(path, gpd.GeoDataFrame({"a": [1, 2]}, geometry=[box(0, 0, 1, 1)] * 2, crs=32651), "old")
    write_zones(path, zones())
    assert [name for name, _ in pyogrio.list_layers(path)] == ["zones", "layer_styles"]


@pytest.mark.parametrize("name", ["Area", "a" * 32])
def test_field_names_that_other_programs_would_change(tmp_path: Path, name: str) -> None:
    frame = gpd.GeoDataFrame({name: [1]}, geometry=[box(0, 0, 1, 1)], crs=32651)
    with pytest.raises(EngineError, match="no field name"):
        write_layer(tmp_path / "a.gpkg", frame, "a")
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_left_when_features_are_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = pyogrio.write_dataframe
    monkeypatch.setattr(geopackage.pyogrio, "write_dataframe", lambda frame, *a, **k: write(frame.iloc[:-1], *a, **k))
    with pytest.raises(EngineError, match="differs"):
        write_zones(tmp_path / "zones.gpkg", zones())
    assert list(tmp_path.iterdir()) == []


def test_missing_folder_is_the_users_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        write_zones(tmp_path / "none" / "zones.gpkg", zones())


def test_reading_layers(tmp_path: Path) -> None:
    write_zones(tmp_path / "zones.gpkg", zones())
    assert len(read_layer(tmp_path / "zones.gpkg", "zones")) == 2
    (tmp_path / "text.gpkg").write_text("not a GeoPackage")
    for path, layer in (("text.gpkg", None), ("none.gpkg", None), ("zones.gpkg", "other")):
        with pytest.raises(InputError, match="cannot be read as a vector file"):
            read_layer(tmp_path / path, layer)


@pytest.mark.parametrize("name", ["new\nline", "tab\there", "a;b", "a!b", "é 中 [1] #2 'q' \"q\""])
def test_folders_of_any_name(tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    write_zones(folder / "zones.gpkg", zones())
    assert [p.name for p in folder.iterdir()] == ["zones.gpkg"]
    assert len(read_layer(folder / "zones.gpkg", "zones")) == len(zones())
