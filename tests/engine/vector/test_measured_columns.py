"""Measured figures cannot be edited, by whatever program; reviews can."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import subprocess
from contextlib import closing
from datetime import date
from pathlib import Path

import geopandas as gpd
import pandas as pd
import pyogrio
import pytest
from slopewatch.engine.vector.measured_columns import guarded_columns
from slopewatch.engine.vector.review_fields import REVIEW_FIELDS
from slopewatch.engine.zones.fields import FIELDS
from slopewatch.tests.builders.zone_layers import entered, opened, zone_layer
from slopewatch.workflows.products.zones import write_zones

WHAT_PEOPLE_DO = """
import json, sys
from qgis.core import QgsApplication, QgsFeature, QgsGeometry, QgsVectorLayer
application = QgsApplication([], False)
application.initQgis()
layer = QgsVectorLayer(sys.argv[1] + "|layername=zones", "zones", "ogr")
layer.loadDefaultStyle()
form = layer.editFormConfig()
index = layer.fields().indexOf
first = next(layer.getFeatures()).id()

def tried(edit):
    layer.startEditing()
    edit()
    done = layer.commitChanges()
    told = " ".join(layer.commitErrors())
    layer.rollBack()
    return [done, told]

def review():
    for name, value in (("review_status", "confirmed"), ("reviewer", "A. Sato"), ("remarks", "crack"),
                        ("chain_from", 12.5), ("Photo", "a.jpg")):
        layer.changeAttributeValue(first, index(name), value)

def another():
    feature = QgsFeature(layer.fields())
    feature["zone_id"] = "Z999"
    layer.addFeature(feature)

moved = QgsGeometry.fromWkt("MultiPolygon(((0 0, 1 0, 1 1, 0 0)))")
print(json.dumps({
    "open": [f.name() for i, f in enumerate(layer.fields()) if not form.readOnly(i)],
    "remarks": layer.editorWidgetSetup(index("remarks")).config().get("IsMultiline"),
    "review": tried(review),
    "figure": tried(lambda: layer.changeAttributeValue(first, index("area_m2"), 1.0)),
    "shape": tried(lambda: layer.changeGeometry(first, moved)),
    "row": tried(another),
    "gone": tried(lambda: layer.deleteFeature(first)),
}))
sys.stdout.flush()
del layer, form
application.exitQgis()
"""


@pytest.fixture
def written(tmp_path: Path) -> Path:
    zones = zone_layer([(0, 0, 4, 4), (10, 0, 13, 3)])
    zones["Photo"] = ["", None]
    path = tmp_path / "zones.gpkg"
    write_zones(path, zones, footprints=zones[["zone_id", "geometry"]], volumes=pd.DataFrame({"raw": [1.0]}))
    return path


def attempt(path: Path, statement: str) -> str:
    """What SQLite says to a change; empty where it was made."""
    with opened(path) as database:
        try:
            database.execute(statement)
        except sqlite3.Error as error:
            return str(error)
    return ""


def test_only_what_people_enter_can_be_changed(written: Path) -> None:
    zones = pyogrio.read_dataframe(written, layer="zones")
    for name in zones.columns.drop("geometry"):
        told = attempt(written, f"UPDATE zones SET {name} = '77' WHERE fid = 1")
        assert bool(told) == (name not in REVIEW_FIELDS and name != "Photo"), name
        assert not told or "Measured columns of zones cannot be edited; enter your review in slope_id" in told
    assert "cannot be edited" in attempt(written, "UPDATE zones SET geom = NULL WHERE fid = 1")
    # a program that writes the whole row back, as GDAL does, is not hindered
    assert not attempt(written, "UPDATE zones SET area_m2 = area_m2, geom = geom, remarks = 'seen' WHERE fid = 2")
    assert "mark a zone as rejected" in attempt(written, "DELETE FROM zones")
    assert "cannot be added" in attempt(written, "INSERT INTO zones (zone_id) VALUES ('Z999')")
    for table in ("footprints", "volumes"):
        column = "zone_id" if table == "footprints" else "raw"
        assert "was measured and cannot be edited" in attempt(written, f"UPDATE {table} SET {column} = 5")
        assert "make the run again" in attempt(written, f"DELETE FROM {table}")
    back = pyogrio.read_dataframe(written, layer="zones")
    assert back["remarks"].tolist() == ["77", "seen"]
    pd.testing.assert_series_equal(back["area_m2"], zones["area_m2"])


def test_the_file_stays_a_sound_geopackage_that_can_be_added_to_and_copied(written: Path, tmp_path: Path) -> None:
    assert not attempt(written, "ALTER TABLE zones ADD COLUMN inspected TEXT")
    assert not attempt(written, "UPDATE zones SET inspected = '2025-06-01'")
    with closing(sqlite3.connect(written)) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert guarded_columns(database, "zones") == {*FIELDS, "fid", "geom"} - set(REVIEW_FIELDS)
        assert guarded_columns(database, "layer_styles") == frozenset()
    zones = gpd.read_file(written, layer="zones")
    assert zones["inspected"].tolist() == ["2025-06-01"] * 2
    zones.to_file(tmp_path / "copy.gpkg", layer="zones")
    assert not attempt(tmp_path / "copy.gpkg", "UPDATE zones SET area_m2 = 1")


def test_the_same_zones_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        zones = entered(zone_layer([(0, 0, 4, 4)]), 0, review_status="confirmed", remarks="it's cracked")
        write_zones(tmp_path / f"{name}.gpkg", zones, stamp=date(2025, 5, 1))
    assert (tmp_path / "a.gpkg").read_bytes() == (tmp_path / "b.gpkg").read_bytes()


def test_qgis_lets_reviews_be_entered_and_nothing_else(written: Path) -> None:
    python = shutil.which("python3", path="/usr/bin:/usr/local/bin")
    asked = [python, "-c", "import qgis.core"]
    if python is None or subprocess.run(asked, capture_output=True, check=False).returncode:
        pytest.skip("no interpreter with QGIS in /usr/bin or /usr/local/bin")
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "GDAL_DATA")}
    home = str(written.parent)
    environment |= {"QT_QPA_PLATFORM": "offscreen", "HOME": home, "XDG_RUNTIME_DIR": home}
    before = pyogrio.read_dataframe(written, layer="zones")
    run = subprocess.run(
        [python, "-c", WHAT_PEOPLE_DO, str(written)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    seen = json.loads(run.stdout.splitlines()[-1])
    assert set(seen["open"]) == {"fid", *REVIEW_FIELDS, "Photo"}
    assert seen["remarks"] is True
    assert seen["review"][0], seen["review"]
    for edit, words in (
        ("figure", "Measured columns of zones cannot be edited"),
        ("shape", "Measured columns of zones cannot be edited"),
        ("row", "Rows of zones are measured"),
        ("gone", "mark a zone as rejected"),
    ):
        assert not seen[edit][0]
        assert words in seen[edit][1]
    after = pyogrio.read_dataframe(written, layer="zones")
    said = ["review_status", "reviewer", "remarks", "chain_from", "Photo"]
    assert after.loc[0, said].tolist() == ["confirmed", "A. Sato", "crack", 12.5, "a.jpg"]
    pd.testing.assert_frame_equal(
        pd.DataFrame(after.drop(columns=[*said, "geometry"])), pd.DataFrame(before.drop(columns=[*said, "geometry"]))
    )
    assert after.geometry.geom_equals(before.geometry).all()
