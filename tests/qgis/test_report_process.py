"""Write report through the real qgis_process, for the results of a change that lie in their folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from qgis.core import QgsRasterLayer
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


def line_across(inputs: Inputs, folder: Path) -> Path:
    """A line along the slope through its middle."""
    extent = QgsRasterLayer(str(inputs.change / "elevation_change.tif")).extent()
    middle = extent.center().y()
    geometry = {"type": "LineString", "coordinates": [[extent.xMinimum(), middle], [extent.xMaximum(), middle]]}
    path = folder / "lines.geojson"
    feature = {"type": "Feature", "properties": {"name": "Across the middle"}, "geometry": geometry}
    path.write_text(json.dumps({**LINES, "features": [feature]}), encoding="utf-8")
    return path
