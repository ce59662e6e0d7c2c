"""Write report through the real qgis_process, for the results of a change that lie in their folder."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from qgis.core import QgsRasterLayer, QgsVectorLayer
from qgis.PyQt.QtGui import QColor, QImage
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.algorithm_runs import reported
from slopewatch.tests.builders.qgis import QgisProcess

LINES = {
    "type": "FeatureCollection",
    "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32651"}},
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    return Inputs(tmp_path_factory.mktemp("inputs"))


def test_a_report_is_written_again_with_a_profile(qgis_process: QgisProcess, inputs: Inputs, tmp_path: Path) -> None:
    before = inputs.change / "report.html"
    before.unlink()
    done = qgis_process.run(
        "writereport", INPUT=inputs.change, PROFILES=line_across(inputs, tmp_path), PROFILE_FIELD="name"
    )
    reported(done, inputs)
    assert Path(done["REPORT"]) == before
    table = Path(done["PROFILE_TABLE"]).read_text(encoding="utf-8").splitlines()
    assert sum("Across the middle" in line for line in table) > 20
    assert Path(done["PROFILE_LINES"]).stat().st_size > 0
    other = qgis_process.attempt("writereport", INPUT=tmp_path)
    assert other.returncode == 1
    assert str(tmp_path) in other.stderr


def test_a_report_to_sign_is_written_with_what_was_said(qgis_process: QgisProcess, inputs: Inputs) -> None:
    done = qgis_process.run("writereport", INPUT=inputs.change, PDF=True, CLIENT="Road Directorate", SENSOR="L1; L2")
    pdf = Path(done["REPORT_PDF"])
    assert pdf == inputs.change / "report.pdf"
    assert pdf.read_bytes().startswith(b"%PDF-")
    record = json.loads((inputs.change / "run.json").read_text(encoding="utf-8"))
    assert record["parameters"]["details"]["client"] == "Road Directorate"
    assert "Road Directorate" in (inputs.change / "report.html").read_text(encoding="utf-8")
    wrong = qgis_process.attempt("writereport", INPUT=inputs.change, PDF=True, SENSOR="L1; L2; L3")
    assert wrong.returncode == 1
    assert "3 parts, and there are 2 surveys" in wrong.stderr


def test_photos_of_a_folder_are_shown_with_their_zones(
    qgis_process: QgisProcess, inputs: Inputs, tmp_path: Path
) -> None:
    run = Path(shutil.copytree(inputs.change, tmp_path / "run"))
    taken = tmp_path / "site visit"
    taken.mkdir()
    for name in ("z001 crack.jpg", "berm.jpg"):
        image = QImage(60, 40, QImage.Format_RGB32)
        image.fill(QColor("red"))
        assert image.save(str(taken / name))
    done = qgis_process.attempt("writereport", INPUT=run, PHOTOS=taken)
    assert done.returncode == 0, done.stderr
    assert "berm.jpg" in done.stderr + done.stdout, "named, as it is of no zone"
    assert "Photo of Z001" in (run / "report.html").read_text(encoding="utf-8")
    zones = QgsVectorLayer(f"{run / 'zones.gpkg'}|layername=zones", "zones", "ogr")
    shown = {zone["zone_id"]: zone["photo"] for zone in zones.getFeatures()}
    assert (run / shown["Z001"]).read_bytes() == (taken / "z001 crack.jpg").read_bytes()
    missing = qgis_process.attempt("writereport", INPUT=run, PHOTOS=tmp_path / "gone")
    assert missing.returncode == 1
    assert "gone" in missing.stderr


def line_across(inputs: Inputs, folder: Path) -> Path:
    """A line along the slope through its middle."""
    extent = QgsRasterLayer(str(inputs.change / "elevation_change.tif")).extent()
    middle = extent.center().y()
    geometry = {"type": "LineString", "coordinates": [[extent.xMinimum(), middle], [extent.xMaximum(), middle]]}
    path = folder / "lines.geojson"
    feature = {"type": "Feature", "properties": {"name": "Across the middle"}, "geometry": geometry}
    path.write_text(json.dumps({**LINES, "features": [feature]}), encoding="utf-8")
    return path
