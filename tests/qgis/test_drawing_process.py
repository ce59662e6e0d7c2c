"""Top view, proposed region and Label Studio's tasks through the real qgis_process and the real engine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsRasterLayer, QgsVectorLayer
from slopewatch.processing_algorithms.topview import TopView
from slopewatch.tests.builders.qgis import QgisProcess


@pytest.fixture(scope="module")
def view(qgis_process: QgisProcess, survey: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("view") / "from above, 'all'"
    return qgis_process.run("topview", INPUT=survey["CLOUD"], ROI=survey["ROI"], OUTPUT_FOLDER=folder)


def test_a_top_view_is_rasters_with_styles_on_one_grid(view: dict[str, Any]) -> None:
    assert set(TopView.NUMBERS) | set(TopView.FILES) <= set(view)
    names = ("TOP_VIEW", "HILLSHADE_RASTER", "DENSITY", "GROUND_DENSITY", "CANOPY_HEIGHT")
    layers = [QgsRasterLayer(view[name]) for name in names]
    assert all(layer.isValid() for layer in layers)
    assert len({(layer.width(), layer.height(), layer.extent().toString()) for layer in layers}) == 1
    assert [layer.renderer().type() for layer in layers] == ["multibandcolor", *["singlebandpseudocolor"] * 4]
    assert layers[2].dataProvider().sourceNoDataValue(1) == -9999
    assert view["MEDIAN_GROUND_DENSITY"] <= view["MEDIAN_DENSITY"]
    assert view["CELL_USED"] == pytest.approx(layers[0].rasterUnitsPerPixelX())


def test_a_region_is_proposed_and_refused_where_nothing_is_left(
    qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path
) -> None:
    output = tmp_path / "roi.gpkg"
    done = qgis_process.run("suggestroi", INPUT=survey["CLOUD"], OUTPUT=output)
    layer = QgsVectorLayer(f"{done['OUTPUT']}|layername=roi", "roi", "ogr")
    assert layer.featureCount() == done["PARTS"] > 0
    assert layer.renderer().type() == "singleSymbol"
    assert 0.7 < done["AREA_SHARE"] <= 1.1
    assert next(layer.getFeatures())["reason"].endswith(".")
    failed = qgis_process.attempt("suggestroi", INPUT=survey["CLOUD"], OUTPUT=tmp_path / "b.gpkg", SPIKE_WIDTH=900)
    assert failed.returncode == 1
    assert "lower “Least density” or “Width of spikes (m)”" in failed.stderr
    assert not (tmp_path / "b.gpkg").exists()


def test_zones_go_to_label_studio_and_back(
    qgis_process: QgisProcess, survey: dict[str, Any], view: dict[str, Any], tmp_path: Path
) -> None:
    given = {"PICTURE": view["TOP_VIEW"], "SEGMENTS": survey["ROI"], "LABEL_FIELD": "name"}
    sent = qgis_process.run("exportlabelstudio", **given, OUTPUT_FOLDER=tmp_path / "tasks")
    (task,) = json.loads(Path(sent["TASKS"]).read_text(encoding="utf-8"))
    annotation = {"id": 1, "completed_by": 1, "result": task["predictions"][0]["result"]}
    export = tmp_path / "export.json"
    export.write_text(json.dumps([{"id": 1, "data": task["data"], "annotations": [annotation]}]), encoding="utf-8")
    output = tmp_path / "labels.gpkg"
    done = qgis_process.run("importlabelstudio", EXPORT=export, TASKS=sent["TASKS"], OUTPUT=output)
    labels = QgsVectorLayer(f"{done['OUTPUT']}|layername=labels", "labels", "ogr")
    assert labels.featureCount() == done["POLYGONS"] == 1
    roi = QgsVectorLayer(survey["ROI"], "roi", "ogr")
    picture = QgsRasterLayer(view["TOP_VIEW"])
    shown = (
        next(roi.getFeatures())
        .geometry()
        .intersection(type(next(roi.getFeatures()).geometry()).fromRect(picture.extent()))
    )
    assert next(labels.getFeatures()).geometry().symDifference(shown).area() < 0.01
    failed = qgis_process.attempt(
        "importlabelstudio", EXPORT=view["RUN_RECORD"], TASKS=sent["TASKS"], OUTPUT=tmp_path / "c.gpkg"
    )
    assert failed.returncode == 1
    assert "is no JSON export of Label Studio" in failed.stderr
