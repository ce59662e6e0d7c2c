"""A flight planned through the real qgis_process over a simulated survey."""

from __future__ import annotations

import json
import subprocess
import zipfile
from pathlib import Path

from qgis.core import QgsVectorLayer
from slopewatch.processing_algorithms.planflight import PlanFlight
from slopewatch.tests.builders.qgis import QgisProcess, engine_python


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


def test_a_flight_is_compared_with_its_plan(qgis_process: QgisProcess, survey: dict[str, Path], tmp_path: Path) -> None:
    given = {"TERRAIN": survey["CLOUD"], "ROI": survey["ROI"], "SURVEY": survey["CLOUD"], "PULSE_RATE": 5000}
    plan = tmp_path / "plan" / "plan.gpkg"
    qgis_process.run("planflight", **given, OUTPUT_FOLDER=plan.parent)
    flown = {"PLAN": plan, "INPUT": survey["CLOUD"], "GROUND": survey["CLOUD"]}
    results = qgis_process.run("compareflight", **flown, OUTPUT_FOLDER=tmp_path / "flown, 'there'")
    assert {"LINES_PLANNED", "RETURNS_RATIO", "GROUND_RATIO", "SHORT_PLACES", "STRIPS_TABLE"} <= set(results)
    places = QgsVectorLayer(f"{results['PLACES']}|layername=places", "places", "ogr")
    short = [place for place in places.getFeatures() if place["short"]]
    assert places.featureCount() > len(short) == results["SHORT_PLACES"]
    missing = tmp_path / "missing.csv"
    missing.write_text("time,x\n", encoding="utf-8")
    done = qgis_process.attempt("compareflight", **flown, TRAJECTORY=missing, OUTPUT_FOLDER=tmp_path / "bad")
    assert done.returncode == 1
    assert "no column y" in done.stderr
    assert not (tmp_path / "bad").exists()


def test_a_season_is_named_and_missions_are_written(qgis_process: QgisProcess, tmp_path: Path) -> None:
    site = tmp_path / "site, 'by season'"
    site.mkdir()
    subprocess.run([engine_python(), "-m", "slopewatch.tests.builders.season_surveys", site], check=True)
    given = {"TERRAIN": site / "dem.tif", "ROI": site / "roi.gpkg", "PULSE_RATE": 20000}
    mission = {"WPML_DRONE": 89, "WPML_PAYLOAD": 65534, "BATTERY_TIME": 1}
    heights = {"TAKEOFF_HEIGHT": "100", "TAKEOFF_ELLIPSOID_HEIGHT": "112.5"}
    surveys = sorted(site.glob("*.las"))
    out = tmp_path / "out"
    results = qgis_process.run("planflight", **given, **mission, **heights, SEASON=surveys, OUTPUT_FOLDER=out)
    record = json.loads(Path(results["RUN_RECORD"]).read_text(encoding="utf-8"))
    season = record["metrics"]["season"]
    assert (season["best_month"], season["worst_month"], len(season["surveys"])) == (3, 7, len(surveys))
    files = sorted(out.glob("*.kmz"))
    assert len(files) == results["BATTERIES"] > 1
    waypoints = 0
    for path in files:
        with zipfile.ZipFile(path) as archive:
            assert {"wpmz/template.kml", "wpmz/waylines.wpml"} <= set(archive.namelist())
        flown = QgsVectorLayer(f"/vsizip/{path}/wpmz/template.kml", "mission", "ogr")
        assert flown.isValid(), "KML to any other reader"
        waypoints += flown.featureCount()
    planned = QgsVectorLayer(f"{results['WAYPOINTS']}|layername=waypoints", "waypoints", "ogr")
    assert waypoints == planned.featureCount()
    done = qgis_process.attempt("planflight", **given, **mission, OUTPUT_FOLDER=tmp_path / "refused")
    assert done.returncode == 1
    assert "height of the take-off point" in done.stderr
    assert not (tmp_path / "refused").exists()
