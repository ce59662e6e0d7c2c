"""A series through the real qgis_process, and its layers in QGIS: styles, and when they are shown."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from qgis.core import (
    Qgis,
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingOutputLayerDefinition,
    QgsProject,
    QgsRasterLayer,
    QgsUnitTypes,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QDateTime, Qt
from slopewatch.processing_algorithms.inspectseries import InspectSeries
from slopewatch.tests.builders.qgis import QgisProcess, Recorder, engine_python, load_results

# Slopes of 10 by 10 m on four days; a square of 3 m sinks by 0.1 m from each to the next.
CLOUDS = """
import sys
import laspy
import numpy as np
from pyproj import CRS
for number in range(4):
    rng = np.random.default_rng(number)
    u, v = rng.uniform(0, 10, (2, 8000))
    square = (np.abs(u - 5) < 1.5) & (np.abs(v - 5) < 1.5)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.x, las.y = 500_000 + u, 3_500_000 + v
    las.z = 50 + 0.5 * v + rng.normal(0, 0.01, u.size) - 0.1 * number * square
    las.return_number = las.number_of_returns = np.ones(u.size, dtype=np.uint8)
    las.write(f"{sys.argv[1]}/2024-0{number + 1}-01.laz")
"""
SETTINGS = {"GROUND_READY": True, "METHOD": "none", "CELL": 0.5}


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clouds")
    subprocess.run([engine_python(), "-c", CLOUDS, str(folder)], check=True)
    return folder


@pytest.fixture(scope="module")
def results(qgis_process: QgisProcess, clouds: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("series") / "out"
    return qgis_process.run("inspectseries", INPUT=clouds, OUTPUT_FOLDER=folder, **SETTINGS)


def test_qgis_process_gives_figures_and_files(results: dict[str, Any]) -> None:
    assert (results["EPOCH_COUNT"], results["ZONE_COUNT"], results["CONFIRMED_ZONES"]) == (4, 1, 1)
    assert len(results["CUMULATIVE"]) == len(results["INCREMENTAL"]) == 3
    for name in ("TABLE", "PICTURE", "ALERTS_USED", "RUN_RECORD", "ZONES", "SERIES", "VELOCITY"):
        assert Path(results[name]).is_file(), name


def test_rasters_are_shown_one_after_the_other(results: dict[str, Any]) -> None:
    for name in ("CUMULATIVE", "INCREMENTAL"):
        ranges = []
        for path in results[name]:
            layer = QgsRasterLayer(path, "dz")
            layer.loadDefaultStyle()
            properties = layer.temporalProperties()
            assert properties.isActive()
            assert properties.mode() == Qgis.RasterTemporalMode.FixedTemporalRange
            assert layer.renderer().type() == "singlebandpseudocolor"
            ranges.append(properties.fixedTemporalRange())
        for day in (10, 40, 80):
            moment = QDateTime.fromString("2024-01-01T12:00:00Z", Qt.DateFormat.ISODate).addDays(day)
            assert sum(r.contains(moment) for r in ranges) == 1
        assert ranges[0].end().date().toString("yyyy-MM-dd") == "2024-02-01"


def test_zones_are_styled_by_alert_and_the_series_by_time(results: dict[str, Any]) -> None:
    zones = QgsVectorLayer(f"{results['ZONES']}|layername=zones", "zones", "ogr")
    assert zones.loadDefaultStyle()[1]
    assert zones.renderer().classAttribute() == "alert_level"
    (feature,) = zones.getFeatures()
    assert (feature["kind"], feature["status"]) == ("subsidence", "active")
    assert feature["rate_low"] < feature["rate_mm_day"] < feature["rate_high"] < 0
    assert zones.renderer().categoryIndexForValue(feature["alert_level"]) == feature["alert_level"]
    assert zones.attributeAlias(zones.fields().indexOf("rate_mm_day")) == "Rate (mm/day)"
    series = QgsVectorLayer(f"{results['SERIES']}|layername=series", "series", "ogr")
    assert series.loadDefaultStyle()[1]
    properties = series.temporalProperties()
    assert properties.isActive()
    assert properties.mode() == Qgis.VectorTemporalMode.FeatureDateTimeStartAndEndFromFields
    assert (properties.startField(), properties.endField()) == ("time_from", "time_to")
    assert series.featureCount() == 3
    assert series.renderer().classAttribute() == "state"


def test_a_manifest_instead_of_a_folder(
    qgis_process: QgisProcess, clouds: Path, results: dict[str, Any], tmp_path: Path
) -> None:
    lines = ["date,path", *(f"2024-0{n}-01,{clouds}/2024-0{n}-01.laz" for n in (1, 2))]
    (tmp_path / "surveys.csv").write_text("\n".join(lines) + "\n")
    given = {"MANIFEST": tmp_path / "surveys.csv", "OUTPUT_FOLDER": tmp_path / "out", **SETTINGS}
    assert qgis_process.run("inspectseries", **given, RASTERS_EACH_SURVEY=False)["EPOCH_COUNT"] == 2
    both = qgis_process.attempt("inspectseries", INPUT=clouds, **given)
    assert both.returncode == 1
    assert "not both" in both.stderr


def test_a_simulated_series_is_inspected_with_its_manifest(qgis_process: QgisProcess, tmp_path: Path) -> None:
    made = qgis_process.run(
        "simulateseries", OUTPUT_FOLDER=tmp_path / "made", POINTS=15000, LENGTH=12, HEIGHT=6, VEGETATION=0, SURVEYS=3,
        VELOCITIES="-6", GROUND_ONLY=True,
    )  # fmt: skip
    assert json.loads(Path(made["TRUTH"]).read_text())["motions"][0]["rate"] == -0.006
    assert QgsVectorLayer(f"{made['ROI']}|layername=roi", "roi", "ogr").featureCount() == 1
    assert QgsRasterLayer(made["TRUTH_VELOCITY"], "velocity").isValid()
    settings = {"GROUND_READY": True, "CELL": 0.25, "RASTERS_EACH_SURVEY": False}
    found = qgis_process.run(
        "inspectseries", MANIFEST=made["MANIFEST"], ROI=made["ROI"], OUTPUT_FOLDER=tmp_path / "found", **settings
    )
    assert (found["EPOCH_COUNT"], found["ZONE_COUNT"]) == (3, 1)
    assert 1 < found["FASTEST_RATE"] < 6


def test_the_dialog_loads_every_survey_with_its_days(
    qgis_processing: Any, provider: Any, feedback: Recorder, clouds: Path, tmp_path: Path
) -> None:
    engine_python()
    project = QgsProject()
    context = QgsProcessingContext()
    context.setProject(project)
    opened = QgsProcessingOutputLayerDefinition(QgsProcessing.TEMPORARY_OUTPUT, project)
    given = {"INPUT": str(clouds), "OUTPUT_FOLDER": str(tmp_path / "out"), **SETTINGS}
    given.update(ZONES=opened, SERIES=opened, VELOCITY=opened)
    algorithm = InspectSeries().create()
    _, ok = algorithm.run(given, context, feedback, catchExceptions=False)
    assert ok
    assert load_results(algorithm, context, feedback, given), [
        x for x in feedback.lines if x[0] in ("error", "warning")
    ]
    layers = {layer.name(): layer for layer in project.mapLayers().values()}
    assert len(layers) == 3 + 6
    last = layers["2024-04-01 change since the first survey"]
    assert last.temporalProperties().fixedTemporalRange().end().date().toString("yyyy-MM-dd") == "2024-04-01"
    assert layers["Zones survey by survey"].temporalProperties().isActive()
    root = project.layerTreeRoot()
    assert {g.name() for g in root.findGroups()} == {
        "SlopeWatch series",
        "SlopeWatch series, change since the first survey",
        "SlopeWatch series, change since the survey before",
    }
    shown = {node.name() for node in root.findLayers() if node.itemVisibilityChecked()}
    assert {name for name in shown if "change" in name} == {last.name()}
    times = [
        layer.temporalProperties().fixedTemporalRange()
        for name, layer in layers.items()
        if name.endswith("change since the first survey")
    ]
    time, first = project.timeSettings(), min(one.begin() for one in times)
    assert (time.temporalRange().begin(), time.temporalRange().end()) == (first, max(one.end() for one in times))
    assert time.timeStepUnit() == QgsUnitTypes.TemporalUnit.TemporalDays
    assert 1 <= time.timeStep() <= first.daysTo(time.temporalRange().end())
    project.clear()
