"""Screen for hazards in the toolbox: its command line, its results and how they are loaded; batches."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from qgis.core import (
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingOutputLayerDefinition,
    QgsProject,
    QgsRasterLayer,
    QgsVectorLayer,
)
from slopewatch.processing_algorithms.screenhazards import ScreenHazards
from slopewatch.processing_algorithms.values import Values
from slopewatch.tests.builders.qgis import Recorder, load_results

pytestmark = pytest.mark.usefixtures("qgis_processing", "provider")
CLOUD = "/data/north_2024-05-01.laz"

ENGINE = """
from osgeo import gdal, ogr, osr
gdal.UseExceptions()
output = value("--output")
given = {sys.argv[k]: sys.argv[k + 1] for k in range(len(sys.argv) - 1)}
stem = output[:-4]
outputs = {
    "labelled": output,
    "zones": given.get("--zones", stem + "_zones.gpkg"),
    "probability": given.get("--raster", stem + "_probability.tif"),
    "smallest_hazard": given.get("--smallest-hazard", stem + "_smallest_hazard.tif"),
    "map": given.get("--map", stem + "_map.png"),
    "run": stem + "_run.json",
}
for key in ("labelled", "map", "run"):
    open(outputs[key], "w").close()
srs = osr.SpatialReference()
srs.ImportFromEPSG(32651)
for key, bands in (("probability", 3), ("smallest_hazard", 4)):
    data = gdal.GetDriverByName("GTiff").Create(outputs[key], 4, 3, bands, gdal.GDT_Float32)
    data.SetGeoTransform((0, 1, 0, 3, 0, -1))
    data.SetProjection(srs.ExportToWkt())
    data.GetRasterBand(1).Fill(0.75)
    data = None
data = ogr.GetDriverByName("GPKG").CreateDataSource(outputs["zones"])
layer = data.CreateLayer("zones", srs, ogr.wkbPolygon)
layer.CreateField(ogr.FieldDefn("kind", ogr.OFTString))
feature = ogr.Feature(layer.GetLayerDefn())
feature["kind"] = "uplift"
feature.SetGeometry(ogr.CreateGeometryFromWkt("POLYGON((0 0,0 1,1 1,0 0))"))
layer.CreateFeature(feature)
layer = data = None
say(event="result", outputs=outputs, metrics={"zone_count": 1, "zone_area_m2": 0.5, "dip": 34.5})
"""


def run(project: QgsProject, feedback: Recorder, **parameters: Any) -> tuple[dict[str, Any], QgsProcessingContext]:
    context = QgsProcessingContext()
    context.setProject(project)
    results, ok = ScreenHazards().create().run({"INPUT": CLOUD, **parameters}, context, feedback, catchExceptions=False)
    assert ok
    return results, context


@pytest.fixture
def project() -> QgsProject:
    project = QgsProject()
    yield project
    project.clear()


def command(**parameters: Any) -> list[str]:
    context = QgsProcessingContext()
    made = ScreenHazards().create()
    return made.command(Values(made, {"INPUT": CLOUD, **parameters}, context, Recorder()))


def test_defaults_pass_nothing_and_others_are_passed() -> None:
    assert command(OUTPUT="/out/a.laz") == ["screen", CLOUD, "--output", "/out/a.laz"]
    given = command(
        OUTPUT="/out/a.laz",
        ZONES="/out/z.gpkg",
        PROBABILITY="/out/p.tif",
        SMALLEST_HAZARD="/out/s.tif",
        MAP="/out/m.png",
        SCREENING_METHOD="residual",
        GROUND="class_2",
        WRITE_CLASSIFICATION=True,
        MINIMUM_PROBABILITY=0.6,
        WEIGHTS="/models/own.safetensors",
    )
    assert given == [
        "screen", CLOUD, "--output", "/out/a.laz", "--zones", "/out/z.gpkg", "--raster", "/out/p.tif",
        "--smallest-hazard", "/out/s.tif",
        "--map", "/out/m.png", "--screening-method", "residual", "--ground", "class_2",
        "--weights", "/models/own.safetensors", "--minimum-probability", "0.6", "--write-classification",
    ]  # fmt: skip


def test_temporary_and_converted_ones_are_left_beside_the_cloud() -> None:
    given = command(OUTPUT="/out/a.laz", ZONES="/out/z.shp", PROBABILITY=QgsProcessing.TEMPORARY_OUTPUT)
    assert given == ["screen", CLOUD, "--output", "/out/a.laz"]


def test_results_where_they_were_asked_for(
    fake_engine: Callable[[str], Path], project: QgsProject, feedback: Recorder, tmp_path: Path
) -> None:
    fake_engine(ENGINE)
    zones, shape = tmp_path / "z.gpkg", tmp_path / "z.shp"
    results, _ = run(project, feedback, OUTPUT=str(tmp_path / "a.laz"), ZONES=str(zones))
    assert results["OUTPUT"] == str(tmp_path / "a.laz")
    assert results["ZONES"] == str(zones)
    assert results["PROBABILITY"] == str(tmp_path / "a_probability.tif")
    assert results["SMALLEST_HAZARD"] == str(tmp_path / "a_smallest_hazard.tif")
    assert results["MAP"] == str(tmp_path / "a_map.png")
    assert results["RUN_RECORD"] == str(tmp_path / "a_run.json")
    assert (results["ZONE_COUNT"], results["ZONE_AREA"], results["DIP"]) == (1, 0.5, 34.5)
    assert not (tmp_path / "a_zones.gpkg").exists()
    results, _ = run(project, feedback, OUTPUT=str(tmp_path / "b.laz"), ZONES=str(shape))
    assert QgsVectorLayer(results["ZONES"], "", "ogr").featureCount() == 1


def test_a_temporary_cloud_works(fake_engine: Callable[[str], Path], project: QgsProject, feedback: Recorder) -> None:
    fake_engine(ENGINE)
    temporary = QgsProcessing.TEMPORARY_OUTPUT
    results, _ = run(project, feedback, OUTPUT=temporary, ZONES=temporary, PROBABILITY=temporary, MAP=temporary)
    assert results["OUTPUT"].endswith(".laz")
    for name in ("OUTPUT", "ZONES", "PROBABILITY", "MAP"):
        assert Path(results[name]).is_file(), name


def test_layers_are_loaded_into_a_group_of_the_survey(
    fake_engine: Callable[[str], Path], project: QgsProject, feedback: Recorder, tmp_path: Path
) -> None:
    fake_engine(ENGINE)
    parameters: dict[str, Any] = {
        name: QgsProcessingOutputLayerDefinition(QgsProcessing.TEMPORARY_OUTPUT, project)
        for name in ("ZONES", "PROBABILITY", "SMALLEST_HAZARD")
    }
    parameters["OUTPUT"] = str(tmp_path / "a.laz")
    _, context = run(project, feedback, **parameters)
    assert load_results(ScreenHazards().create(), context, feedback, parameters)
    group = project.layerTreeRoot().findGroup("SlopeWatch north_2024-05-01")
    assert [(node.name(), node.itemVisibilityChecked()) for node in group.findLayers()] == [
        ("Hazard zones (screening)", True),
        ("Probability of a hazard", False),
        ("Smallest hazard (m)", False),
    ]
    assert {Path(layer.source().partition("|")[0]).parent for layer in project.mapLayers().values()} == {tmp_path}


def test_a_batch_writes_every_row(
    fake_engine: Callable[[str], Path], project: QgsProject, feedback: Recorder, tmp_path: Path
) -> None:
    fake_engine(ENGINE)
    context = QgsProcessingContext()
    context.setProject(project)
    algorithm = ScreenHazards().create()
    for row in ("north", "south"):
        raster = QgsProcessingOutputLayerDefinition(str(tmp_path / f"{row}.tif"), project)
        parameters = {"INPUT": f"/data/{row}.laz", "OUTPUT": str(tmp_path / f"{row}.laz"), "PROBABILITY": raster}
        results, ok = algorithm.create().run(parameters, context, feedback)
        assert ok
        assert results["PROBABILITY"] == str(tmp_path / f"{row}.tif")
        assert QgsRasterLayer(results["PROBABILITY"]).isValid()
    assert set(context.layersToLoadOnCompletion()) == {str(tmp_path / f"{row}.tif") for row in ("north", "south")}
