"""A flight planned through the real qgis_process over a simulated survey."""

from __future__ import annotations

from pathlib import Path

from qgis.core import QgsVectorLayer
from slopewatch.processing_algorithms.planflight import PlanFlight
from slopewatch.tests.builders.qgis import QgisProcess


def test_a_flight_is_planned_and_one_that_is_too_low_refused(
    qgis_process: QgisProcess, survey: dict[str, Path], tmp_path: Path
) -> None:
    given = {"TERRAIN": survey["CLOUD"], "ROI": survey["ROI"], "SURVEY": survey["CLOUD"], "PULSE_RATE": 5000}
    results = qgis_process.run("planflight", **given, OUTPUT_FOLDER=tmp_path / "out, 'plan'")
    assert {*PlanFlight.NUMBERS, *PlanFlight.FILES} <= set(results)
    lines = QgsVectorLayer(f"{results['LINES']}|layername=lines", "lines", "ogr")
    assert lines.featureCount() == results["LINE_COUNT"] >= 2
    assert lines.renderer().symbol().color().name() == "#d96b1e"
    done = qgis_process.attempt("planflight", **given, ALTITUDE=6, OUTPUT_FOLDER=tmp_path / "low")
    assert done.returncode == 1
    assert "ground or plants" in done.stderr
    assert not (tmp_path / "low" / "run.json").exists()
