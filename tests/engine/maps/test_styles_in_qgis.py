"""Styles as QGIS itself understands and draws them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pyproj import CRS
from slopewatch.engine.grid.geotiff import write_bands, write_raster
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.maps import opacity_band
from slopewatch.engine.maps.palette import SEQUENTIAL
from slopewatch.engine.maps.qgis_styles import (
    change_qml,
    labelled_points_qml,
    level_qml,
    write_qml_next_to,
)
from slopewatch.engine.zones.extraction import footprint_frame
from slopewatch.engine.zones.fields import ZONE_KINDS
from slopewatch.interface.parameters import ZoneParameters
from slopewatch.tests.builders.change_zones import zones_of
from slopewatch.tests.builders.styles import stops
from slopewatch.workflows.products.zones import write_zones

GRID = Grid(west=500000.0, north=4000030.0, cell=0.5, rows=60, columns=80)


SCRIPT = """
import json, sys
from qgis.core import (QgsApplication, QgsExpression, QgsExpressionContext, QgsExpressionContextUtils,
    QgsMapRendererParallelJob, QgsMapSettings, QgsPointCloudLayer, QgsRasterLayer, QgsVectorLayer)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor
application = QgsApplication([], False)
application.initQgis()
folder = sys.argv[1]

def draw(layers, name):
    settings = QgsMapSettings()
    settings.setLayers(layers)
    settings.setDestinationCrs(layers[0].crs())
    settings.setExtent(raster.extent())
    settings.setOutputSize(QSize(800, 600))
    settings.setBackgroundColor(QColor("white"))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    job.renderedImage().save(folder + "/" + name)

def shown(layer, feature, name):
    index = layer.fields().indexOf(name)
    setup = layer.editorWidgetSetup(index)
    formatter = QgsApplication.fieldFormatterRegistry().fieldFormatter(setup.type())
    return formatter.representValue(layer, index, setup.config(), None, feature[name])

raster = QgsRasterLayer(folder + "/elevation_change.tif", "change")  # finds its style by itself
level = QgsRasterLayer(folder + "/level_of_detection.tif", "level")
zones = QgsVectorLayer(folder + "/zones.gpkg", "zones", "ogr")
footprints = QgsVectorLayer(folder + "/zones.gpkg|layername=footprints", "footprints", "ogr")
empty = QgsVectorLayer(folder + "/empty.gpkg", "zones", "ogr")
for layer, name in ((raster, "raster.png"), (level, "level.png"), (zones, "zones.png"), (footprints, "footprints.png")):
    draw([layer], name)
draw([zones, footprints], "both.png")
label = QgsExpression(footprints.labeling().settings().fieldName)
context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(footprints))
told = []
for feature in footprints.getFeatures():
    context.setFeature(feature)
    values = [feature[name] for name in ("zone_id", "kind", "vol_net_m3", "vol_err_m3")]
    told.append([*values, label.evaluate(context)])
review = zones.fields().indexOf("review_status")
cloud = QgsPointCloudLayer(folder + "/labelled.laz", "cloud", "copc")  # not every build opens it
message, styled = cloud.loadNamedStyle(folder + "/labelled.qml")
renderer = cloud.renderer()
points = [styled, renderer.type(), renderer.attribute(),
    [[c.value(), c.label(), c.color().name()] for c in renderer.categories()]]
del cloud, renderer
print(json.dumps({
    "raster": raster.renderer().type(),
    "raster_stops": [i.value for i in raster.renderer().shader().rasterShaderFunction().colorRampItemList()],
    "raster_crs": raster.crs().authid(),
    "level_stops": [i.value for i in level.renderer().shader().rasterShaderFunction().colorRampItemList()],
    "zones": zones.featureCount(),
    "categories": [c.label() for c in zones.renderer().categories()],
    "label": zones.labeling().settings().fieldName if zones.labelsEnabled() else "",
    "alias": zones.attributeAlias(zones.fields().indexOf("dz_mean_m")),
    "widget": zones.editorWidgetSetup(review).type(),
    "choices": [list(c.values())[0] for c in zones.editorWidgetSetup(review).config()["map"]],
    "shown": [shown(zones, f, name) for f in zones.getFeatures() for name in ("dz_mean_m", "area_m2")],
    "footprints": [c.value() for c in footprints.renderer().categories()],
    "told": told,
    "footprint_tip": "vol_low_m3" in footprints.mapTipTemplate(),
    "tip": "vol_err_m3" in zones.mapTipTemplate(),
    "points": points,
    "empty": [empty.isValid(), empty.featureCount(), empty.renderer().type()],
}))
sys.stdout.flush()
del raster, level, zones, footprints, empty, layer, context, feature
application.exitQgis()
"""


@pytest.fixture(scope="module")
def qgis_python() -> str:
    """QGIS's own interpreter."""
    python = shutil.which("python3", path="/usr/bin:/usr/local/bin")
    if (
        python is None
        or subprocess.run([python, "-c", "import qgis.core"], capture_output=True, check=False).returncode
    ):
        pytest.skip("no interpreter with QGIS in /usr/bin or /usr/local/bin")
    return python


def test_qgis_loads_and_draws_the_styles(tmp_path: Path, qgis_python: str) -> None:
    dz = np.full(GRID.shape, 0.02)
    dz[10:30, 10:30] = -0.4
    dz[30:50, 50:70] = 0.4
    dz[50:, :20] = np.nan
    level = np.full(dz.shape, 0.1)
    level[10:30, 20:30] = 0.6  # here the same change is within the level
    bands = {"Elevation change": dz, opacity_band.NAME: opacity_band.opacity(dz, np.abs(dz) > level)}
    write_bands(tmp_path / "elevation_change.tif", bands, GRID, CRS(32651), unit=("m", opacity_band.UNIT))
    write_qml_next_to(tmp_path / "elevation_change.tif", change_qml(0.5, opacity_band=opacity_band.BAND))
    level[:] = 0.1
    write_raster(tmp_path / "level_of_detection.tif", level, GRID, CRS(32651), description="Level of detection")
    write_qml_next_to(tmp_path / "level_of_detection.tif", level_qml(0.2))
    for name, significant in (("zones", np.nan_to_num(np.abs(dz)) > level), ("empty", np.zeros(dz.shape, bool))):
        count = np.ones(dz.shape, int)
        found = zones_of(dz, significant, level, level / 2, count, GRID, CRS(32651), ZoneParameters())
        write_zones(tmp_path / f"{name}.gpkg", found.frame, footprints=footprint_frame(found, GRID))

    write_qml_next_to(tmp_path / "labelled.laz", labelled_points_qml("slopewatch_class"))

    environment = {
        k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "GDAL_DATA", "PROJ_LIB")
    }
    environment |= {"QT_QPA_PLATFORM": "offscreen", "HOME": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)}
    run = subprocess.run(
        [qgis_python, "-c", SCRIPT, str(tmp_path)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    seen = json.loads(run.stdout.splitlines()[-1])
    assert seen["raster"] == "singlebandpseudocolor"
    assert seen["raster_stops"] == pytest.approx([value for value, *_ in stops(change_qml(0.5))])
    assert seen["raster_crs"] == "EPSG:32651"
    assert seen["level_stops"] == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2])
    assert seen["zones"] == 2
    assert seen["categories"][0] == "Subsidence, high"
    assert len(seen["categories"]) == 12
    assert seen["label"] == "zone_id"
    assert seen["alias"] == "Mean change (m)"
    assert seen["widget"] == "ValueMap"
    assert seen["choices"] == ["unreviewed", "confirmed", "rejected"]
    # 400 cells of 0.25 m² sank by 0.4 m, as many rose
    assert sorted(seen["shown"]) == ["-0.400", "0.400", "100.00", "100.00"]
    assert seen["tip"]
    assert sorted(seen["footprints"]) == sorted(ZONE_KINDS)
    assert seen["footprint_tip"]
    for zone, kind, volume, error, words in seen["told"]:
        assert (volume > 0) == (kind == "uplift")
        assert words == f"{zone}: {volume:+.2f} ± {error:.2f} m³"
    assert seen["empty"] == [True, 0, "categorizedSymbol"]
    styled, kind, attribute, categories = seen["points"]
    assert (styled, kind, attribute) == (True, "classified", "slopewatch_class")
    assert [category[:2] for category in categories] == [[0, "Background"], [1, "Uplift"], [2, "Subsidence"]]
    assert len({colour for *_, colour in categories}) == 3

    def pixel(picture: str, row: int, column: int) -> np.ndarray:
        with Image.open(tmp_path / picture) as image:
            return np.array(image.convert("RGB").getpixel((column * 10 + 5, row * 10 + 5))).astype(int)

    for picture, strength in (("raster.png", 100), ("zones.png", 30)):
        lowered, raised = pixel(picture, 13, 13), pixel(picture, 33, 53)
        assert lowered[0] > lowered[2] + strength
        assert raised[2] > raised[0] + strength
    within = pixel("raster.png", 13, 23)  # lowered as much as at column 13
    assert 0 < np.ptp(within) < 0.3 * np.ptp(pixel("raster.png", 13, 13))
    assert within.min() > 200
    assert np.ptp(pixel("raster.png", 5, 5)) < 10
    assert pixel("raster.png", 5, 5).tolist() != [255, 255, 255]
    assert pixel("raster.png", 55, 5).tolist() == [255, 255, 255]  # no data
    assert pixel("zones.png", 5, 5).tolist() == [255, 255, 255]
    # the footprint reaches around the zone, over which it is a veil; far from it nothing is drawn
    beside = pixel("footprints.png", 8, 20)
    assert 20 < 255 - beside[2] < 120
    assert beside[0] > beside[2] + 10
    assert pixel("footprints.png", 5, 5).tolist() == [255, 255, 255]
    assert pixel("zones.png", 8, 20).tolist() == [255, 255, 255]
    assert pixel("both.png", 13, 13)[0] > pixel("both.png", 13, 13)[2] + 30
    assert np.abs(pixel("level.png", 5, 5) - SEQUENTIAL[2][1]).max() <= 2
