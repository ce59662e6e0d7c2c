"""A corridor through the real qgis_process: figures, layers, the virtual point cloud and the mosaic in QGIS."""

from __future__ import annotations

import json
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsPointCloudLayer, QgsProject, QgsProviderRegistry, QgsRasterLayer, QgsVectorLayer
from slopewatch.plugin.bridge.project_contents import SLOPES
from slopewatch.tests.builders.qgis import QgisProcess, engine_python

# A slope of 12 by 12 m with some grass on two days, a square of 3 m lowered between them; and one survey cut short.
CLOUDS = """
import sys
from pathlib import Path
import laspy
import numpy as np
from pyproj import CRS
folder = Path(sys.argv[1])
for number in range(2):
    rng = np.random.default_rng(number)
    u, v = rng.uniform(0, 12, (2, 15000))
    square = (np.abs(u - 6) < 1.5) & (np.abs(v - 6) < 1.5)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.x, las.y = 500_000 + u, 3_500_000 + v
    las.z = 50 + 0.5 * v + rng.normal(0, 0.01, u.size) - 0.4 * number * square
    las.return_number = las.number_of_returns = np.ones(u.size, dtype=np.uint8)
    las.write(folder / f"2024-0{number + 1}-01.laz")
data = (folder / "2024-01-01.laz").read_bytes()
(folder / "short.laz").write_bytes(data[: len(data) // 2])
lines = ["slope,date,file,roi", "S1,2024-01-01,2024-01-01.laz,", "S1,2024-02-01,2024-02-01.laz,"]
(folder / "corridor.csv").write_text("\\n".join([*lines, "S2,2024-01-01,short.laz,"]))
"""


@pytest.fixture(scope="module")
def results(qgis_process: QgisProcess, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("corridor")
    subprocess.run([engine_python(), "-c", CLOUDS, str(folder)], check=True)
    return qgis_process.run(
        "corridorbatch", MANIFEST=folder / "corridor.csv", OUTPUT_FOLDER=folder / "out", WORKERS=2, CELL=0.5,
        SCREEN_LAST_EPOCH=False,
    )  # fmt: skip


def test_figures_and_layers(results: dict[str, Any]) -> None:
    assert (results["SLOPE_COUNT"], results["SLOPES_DONE"], results["SLOPES_FAILED"]) == (2, 1, 1)
    assert results["OPEN_ALERTS"] == 1
    zones = QgsVectorLayer(f"{results['ZONES']}|layername=zones", "zones", "ogr")
    (zone,) = zones.getFeatures()
    assert zone["slope"] == "S1"
    assert zones.loadDefaultStyle()[1]
    assert "attention" in zones.renderer().classAttribute()
    assert zones.renderer().categoryIndexForValue(zone["attention"]) == zone["attention"] > 0
    slopes = QgsVectorLayer(f"{results['SLOPES']}|layername=slopes", "slopes", "ogr")
    assert {f["slope"]: f["state"] for f in slopes.getFeatures()} == {"S1": "done", "S2": "failed"}
    for name in ("PAGE", "CORRIDOR", "CLOUDS", "MOSAIC", "RUN_RECORD"):
        assert Path(results[name]).is_file(), name


def test_alerts_are_edited_in_qgis(results: dict[str, Any]) -> None:
    alerts = QgsVectorLayer(f"{results['ALERTS']}|layername=alerts", "alerts", "ogr")
    (alert,) = alerts.getFeatures()
    assert alert["state"] == "raised"
    assert alerts.loadDefaultStyle()[1]
    assert alerts.renderer().categoryIndexForValue("raised") == 0
    assert alerts.editorWidgetSetup(alerts.fields().indexOf("state")).type() == "ValueMap"
    assert not alerts.editFormConfig().readOnly(alerts.fields().indexOf("state_reason"))
    assert alerts.editFormConfig().readOnly(alerts.fields().indexOf("reason"))
    state, attention = (alerts.fields().indexOf(name) for name in ("state", "attention"))
    assert alerts.startEditing()
    assert alerts.changeAttributeValue(alert.id(), state, "closed")
    assert alerts.commitChanges(), alerts.commitErrors()
    assert alerts.startEditing()
    assert alerts.changeAttributeValue(alert.id(), attention, 0)
    assert not alerts.commitChanges(), "what was measured is guarded"
    alerts.rollBack()


def test_the_mosaic_and_the_virtual_point_cloud_open(results: dict[str, Any]) -> None:
    mosaic = QgsRasterLayer(results["MOSAIC"], "mosaic")
    assert mosaic.isValid()
    assert mosaic.crs().authid() == "EPSG:32651"
    if "vpc" not in QgsProviderRegistry.instance().providerList():
        pytest.skip("this QGIS was built without virtual point clouds")
    clouds = QgsPointCloudLayer(results["CLOUDS"], "clouds", "vpc")
    assert clouds.isValid()
    assert clouds.pointCount() > 10_000
    assert clouds.crs().authid() == "EPSG:32651"
    assert clouds.extent().width() == pytest.approx(12, abs=0.1)


def test_a_corridor_is_handed_over_as_project_and_archive(
    qgis_process: QgisProcess, results: dict[str, Any], tmp_path: Path
) -> None:
    """By the toolbox, from the corridor's own folder; a slope that failed is in neither."""
    corridor = Path(results["RUN_RECORD"]).parent
    archive = tmp_path / "hand over.zip"
    done = qgis_process.run("exportgis", INPUT=corridor, FORMATS="gpkg,cog,stac,report", OUTPUT=archive)
    with zipfile.ZipFile(archive) as held:
        names = held.namelist()
        items = [link for link in json.loads(held.read("collection.json"))["links"] if link["rel"] == "item"]
    assert done["FILES"] == len(names)
    assert len({name.split("/")[1] for name in names if name.startswith("slopes/")}) == 1 == len(items) - 1
    change = next(name for name in names if name.endswith("/rasters/elevation_change.tif"))
    raster = QgsRasterLayer(f"/vsizip/{archive}/{change}", "change")
    assert raster.isValid()
    assert raster.crs().authid() == "EPSG:32651"
    made = qgis_process.run("createproject", INPUT=corridor, OUTPUT=corridor / "corridor.qgz")
    project = QgsProject()
    assert project.read(made["OUTPUT"])
    layers = project.mapLayers().values()
    assert len(layers) == made["LAYERS"] > 5
    assert all(layer.isValid() for layer in layers)
    assert {"S1"} == {group.name() for group in project.layerTreeRoot().findGroup(SLOPES).findGroups()}
