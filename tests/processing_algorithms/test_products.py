"""The products of a run as layers: in the folder, as copies, loaded with their styles, and chained in models."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from qgis.core import (
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingModelAlgorithm,
    QgsProcessingModelChildAlgorithm,
    QgsProcessingModelChildParameterSource,
    QgsProcessingModelOutput,
    QgsProcessingModelParameter,
    QgsProcessingOutputLayerDefinition,
    QgsProcessingParameterFile,
    QgsProcessingUtils,
    QgsProject,
    QgsRasterLayer,
    QgsVectorLayer,
)
from slopewatch.processing_algorithms import products
from slopewatch.processing_algorithms.inspectslope import InspectSlope
from slopewatch.tests.builders.qgis import Recorder, load_results

pytestmark = pytest.mark.usefixtures("qgis_processing", "provider")
FIRST, LATER = "/data/2024-05-01.laz", "/data/2025-05-01.laz"
NAMES = [p.name for p in products.CHANGE_PRODUCTS]

ENGINE = """
from osgeo import gdal, ogr, osr
gdal.UseExceptions()
folder = value("--output-dir")
os.makedirs(folder, exist_ok=True)
srs = osr.SpatialReference()
srs.ImportFromEPSG(32651)
outputs = {}
def raster(key, name, *numbers):
    path = os.path.join(folder, name)
    data = gdal.GetDriverByName("GTiff").Create(path, 4, 3, len(numbers), gdal.GDT_Float32)
    data.SetGeoTransform((0, 1, 0, 3, 0, -1))
    data.SetProjection(srs.ExportToWkt())
    for band, number in enumerate(numbers, 1):
        data.GetRasterBand(band).Fill(number)
    data = None
    with open(path[:-4] + ".qml", "w") as qml:
        qml.write('<!DOCTYPE qgis><qgis version="3.34.0"><pipe><rasterrenderer type="singlebandpseudocolor" band="1" '
                  'opacity="1" alphaBand="-1" classificationMin="-1" classificationMax="1"><rastershader>'
                  '<colorrampshader colorRampType="INTERPOLATED" minimumValue="-1" maximumValue="1">'
                  '<item value="-1" color="#ff0000" alpha="255" label="low"/>'
                  '<item value="1" color="#0000ff" alpha="255" label="high"/></colorrampshader></rastershader>'
                  '</rasterrenderer></pipe></qgis>')
    outputs[key] = path
raster("elevation_change", "elevation_change.tif", 0.25)
raster("level_of_detection", "level_of_detection.tif", 0.05)
raster("significant_change", "significant_change.tif", 0.5)
raster("heatmap_raster", "heatmap.tif", 1)
raster("top_view", "top_view.tif", 2)
for number, key in enumerate(
    ("change_probability", "cell_size", "plant_error", "plant_change", "point_counts", "seen"), 3
):
    raster(key, key + ".tif", number)
raster("surface_heights", "surface_heights.tif", 7, 8)
outputs["zones"] = os.path.join(folder, "zones.gpkg")
data = ogr.GetDriverByName("GPKG").CreateDataSource(outputs["zones"])
layer = data.CreateLayer("zones", srs, ogr.wkbPolygon)
layer.CreateField(ogr.FieldDefn("kind", ogr.OFTString))
for number, kind in enumerate(("uplift", "subsidence", "uplift")):
    feature = ogr.Feature(layer.GetLayerDefn())
    feature["kind"] = kind
    feature.SetGeometry(ogr.CreateGeometryFromWkt(f"POLYGON(({number} 0,{number} 1,{number + 1} 1,{number} 0))"))
    layer.CreateFeature(feature)
for name in ("footprints", "unsure", "not_seen"):
    data.CreateLayer(name, srs, ogr.wkbPolygon)
layer = data = None
outputs["classes"] = os.path.join(folder, "budget_by_class.gpkg")
data = ogr.GetDriverByName("GPKG").CreateDataSource(outputs["classes"])
data.CreateLayer("budget_by_class", srs, ogr.wkbPolygon)
data = None
outputs["objects"] = os.path.join(folder, "objects.gpkg")
data = ogr.GetDriverByName("GPKG").CreateDataSource(outputs["objects"])
data.CreateLayer("objects", srs, ogr.wkbPolygon)
data = None
import sqlite3
database = sqlite3.connect(outputs["zones"])
columns = ("f_table_catalog", "f_table_schema", "f_table_name", "f_geometry_column", "styleName", "styleQML",
           "styleSLD", "useAsDefault", "description", "owner", "ui", "update_time")
database.execute(f"CREATE TABLE layer_styles (id INTEGER PRIMARY KEY, {', '.join(columns)})")
qml = ('<!DOCTYPE qgis><qgis version="3.34.0"><renderer-v2 type="categorizedSymbol" attr="kind"><categories>'
       '<category value="uplift" label="up" symbol="0" render="true" type="string"/></categories><symbols>'
       '<symbol type="fill" name="0"><layer class="SimpleFill" enabled="1"/></symbol></symbols></renderer-v2></qgis>')
row = ("", "", "zones", "geom", "SlopeWatch", qml, "", 1, "", "", "", "2025-05-01T00:00:00.000Z")
database.execute(f"INSERT INTO layer_styles VALUES (1, {', '.join('?' * 12)})", row)
database.commit()
database.close()
files = {"heatmap": "heatmap.png", "transform": "transform.json", "run": "run.json", "report": "report.html"}
for key, name in files.items():
    outputs[key] = os.path.join(folder, name)
    open(outputs[key], "w").close()
say(event="result", outputs=outputs, metrics={"zone_count": 3, "vol_loss_m3": 1.5, "common_cell_rate": 0.9})
"""

# a run that also measured motion along the surface, with so many significant vectors
MOTION = """
outputs["displacement_vectors"] = os.path.join(folder, "displacement.gpkg")
data = ogr.GetDriverByName("GPKG").CreateDataSource(outputs["displacement_vectors"])
triangle = "POLYGON((0 0,0 1,1 1,0 0))"
for name, kind, place in (("vectors", ogr.wkbPoint, "POINT(1 1)"), ("zones", ogr.wkbPolygon, triangle)):
    layer = data.CreateLayer(name, srs, kind)
    for _ in range(COUNT):
        feature = ogr.Feature(layer.GetLayerDefn())
        feature.SetGeometry(ogr.CreateGeometryFromWkt(place))
        layer.CreateFeature(feature)
layer = data = None
raster("displacement", "displacement.tif", 0.1)
raster("smallest_motion", "smallest_motion.tif", 0.03)
say(event="result", outputs=outputs, metrics={"significant_vectors": COUNT, "moving_zone_count": COUNT})
"""


@pytest.fixture
def engine(fake_engine: Callable[[str], Path]) -> None:
    fake_engine(ENGINE)


@pytest.fixture
def project() -> QgsProject:
    project = QgsProject()
    yield project
    project.clear()


def run(project: QgsProject, feedback: Recorder, **parameters: Any) -> tuple[dict[str, Any], QgsProcessingContext]:
    context = QgsProcessingContext()
    context.setProject(project)
    given = {"REFERENCE": FIRST, "CLOUD": LATER, **parameters}
    results, ok = InspectSlope().create().run(given, context, feedback, catchExceptions=False)
    assert ok
    return results, context


def to_load(value: str, project: QgsProject) -> QgsProcessingOutputLayerDefinition:
    """A destination as the dialog gives it where "open after running" is ticked."""
    return QgsProcessingOutputLayerDefinition(value, project)


def load(context: QgsProcessingContext, parameters: dict[str, Any], feedback: Recorder) -> None:
    """What QGIS's dialog does after a run."""
    assert load_results(InspectSlope().create(), context, feedback, parameters)


@pytest.mark.usefixtures("engine")
class TestDestinations:
    def test_without_any_the_folders_files_are_the_results(
        self, project: QgsProject, feedback: Recorder, tmp_path: Path
    ) -> None:
        results, context = run(project, feedback, OUTPUT_FOLDER=str(tmp_path / "out"))
        for product in products.CHANGE_PRODUCTS:
            assert Path(results[product.name]).parent == tmp_path / "out"
            assert Path(results[product.name]).is_file()
        assert results["HEATMAP_PICTURE"] == str(tmp_path / "out" / "heatmap.png")
        assert results["RUN_RECORD"] == str(tmp_path / "out" / "run.json")
        assert results["REPORT"] == str(tmp_path / "out" / "report.html")
        assert InspectSlope().create().outputDefinition("REPORT").type() == "outputHtml"
        assert results["OUTPUT_FOLDER"] == str(tmp_path / "out")
        assert (results["ZONE_COUNT"], results["LOSS"], results["COMMON_CELL_RATE"]) == (3, 1.5, 0.9)
        assert context.layersToLoadOnCompletion() == {}

    def test_a_temporary_one_is_the_folders_file(self, project: QgsProject, feedback: Recorder, tmp_path: Path) -> None:
        results, _ = run(project, feedback, OUTPUT_FOLDER=str(tmp_path / "out"), ZONES=QgsProcessing.TEMPORARY_OUTPUT)
        assert results["ZONES"] == str(tmp_path / "out" / "zones.gpkg")

    def test_one_in_the_folder_itself_is_no_copy(self, project: QgsProject, feedback: Recorder, tmp_path: Path) -> None:
        path = str(tmp_path / "out" / "zones.gpkg")
        results, _ = run(project, feedback, OUTPUT_FOLDER=str(tmp_path / "out"), ZONES=path)
        assert results["ZONES"] == path
        assert QgsVectorLayer(path, "", "ogr").featureCount() == 3

    def test_another_path_gets_a_copy_with_its_style(
        self, project: QgsProject, feedback: Recorder, tmp_path: Path
    ) -> None:
        raster, zones, shape = tmp_path / "new" / "dz.tif", tmp_path / "z.gpkg", tmp_path / "z.shp"
        parameters = {"OUTPUT_FOLDER": str(tmp_path / "out"), "ELEVATION_CHANGE": str(raster)}
        results, _ = run(project, feedback, **parameters, ZONES=str(zones))
        assert (results["ELEVATION_CHANGE"], results["ZONES"]) == (str(raster), str(zones))
        layer = QgsRasterLayer(str(raster), "dz")
        assert layer.renderer().type() == "singlebandpseudocolor"
        assert layer.dataProvider().sample(layer.extent().center(), 1) == (0.25, True)
        assert QgsVectorLayer(f"{zones}|layername=zones", "", "ogr").featureCount() == 3
        results, _ = run(project, feedback, **parameters, ZONES=str(shape))
        assert QgsVectorLayer(results["ZONES"], "", "ogr").featureCount() == 3

    def test_a_temporary_folder_works(self, project: QgsProject, feedback: Recorder) -> None:
        results, _ = run(project, feedback, OUTPUT_FOLDER=QgsProcessing.TEMPORARY_OUTPUT)
        assert results["OUTPUT_FOLDER"].startswith(QgsProcessingUtils.tempFolder())
        assert Path(results["ZONES"]).parent == Path(results["OUTPUT_FOLDER"])

    def test_a_copy_that_cannot_be_written_is_an_error(
        self, project: QgsProject, feedback: Recorder, tmp_path: Path
    ) -> None:
        (tmp_path / "file").write_text("")
        with pytest.raises(Exception, match="cannot be written"):
            run(project, feedback, OUTPUT_FOLDER=str(tmp_path / "o"), TOP_VIEW=str(tmp_path / "file" / "t.tif"))


@pytest.mark.usefixtures("engine")
class TestLoading:
    def test_layers_come_styled_named_ordered_and_in_a_group(
        self, project: QgsProject, feedback: Recorder, tmp_path: Path
    ) -> None:
        parameters: dict[str, Any] = {n: to_load(QgsProcessing.TEMPORARY_OUTPUT, project) for n in NAMES}
        parameters["OUTPUT_FOLDER"] = str(tmp_path / "out")
        _, context = run(project, feedback, **parameters)
        assert {Path(p).parent for p in context.layersToLoadOnCompletion()} == {tmp_path / "out"}
        load(context, parameters, feedback)
        group = project.layerTreeRoot().findGroup("SlopeWatch 2024-05-01 to 2025-05-01")
        assert [(node.name(), node.itemVisibilityChecked()) for node in group.findLayers()] == [
            ("Objects above the ground", True),
            ("Hazard zones", True),
            ("Change by class of asset", False),
            ("Footprints of the volumes", False),
            ("Unsure change", False),
            ("Not seen", True),
            ("Significant change (m)", True),
            ("Seen and not seen", False),
            ("Elevation change (m)", False),
            ("Level of detection (m)", False),
            ("Probability of change", False),
            ("Size of the cells (m)", False),
            ("Error by plants (m)", False),
            ("Change that plants explain (m)", False),
            ("Heatmap", False),
            ("Top view", True),
            ("Ground heights, later survey (m)", False),
            ("Ground heights, earlier survey (m)", False),
            ("Ground points in each cell", False),
        ]
        for name, band in (("earlier", 1), ("later", 2)):
            surface = project.mapLayersByName(f"Ground heights, {name} survey (m)")[0]
            assert Path(surface.source()) == tmp_path / "out" / "surface_heights.tif"
            elevation = surface.elevationProperties()
            assert (elevation.isEnabled(), elevation.bandNumber()) == (True, band)
            assert (surface.renderer().type(), surface.renderer().usesBands()) == ("hillshade", [band])
        change = project.mapLayersByName("Elevation change (m)")[0]
        assert change.renderer().type() == "singlebandpseudocolor"
        assert Path(change.source()).parent == tmp_path / "out"
        assert project.mapLayersByName("Hazard zones")[0].renderer().type() == "categorizedSymbol"
        assert feedback.said("warning") == []

    def test_what_is_not_to_be_loaded_is_not(self, project: QgsProject, feedback: Recorder, tmp_path: Path) -> None:
        parameters = {
            "OUTPUT_FOLDER": str(tmp_path / "out"),
            "ZONES": to_load(str(tmp_path / "copy.gpkg"), project),
            "ELEVATION_CHANGE": QgsProcessing.TEMPORARY_OUTPUT,
        }
        _, context = run(project, feedback, **parameters)
        load(context, parameters, feedback)
        assert [layer.source().partition("|")[0] for layer in project.mapLayers().values()] == [
            str(tmp_path / "copy.gpkg")
        ]

    def test_a_broken_style_is_said(self, project: QgsProject, feedback: Recorder, tmp_path: Path) -> None:
        parameters = {
            "OUTPUT_FOLDER": str(tmp_path / "out"),
            "ELEVATION_CHANGE": to_load(QgsProcessing.TEMPORARY_OUTPUT, project),
        }
        _, context = run(project, feedback, **parameters)
        (tmp_path / "out" / "elevation_change.qml").write_text("no style")
        load(context, parameters, feedback)
        assert any("elevation_change.tif" in line for line in feedback.said("warning"))


def test_the_log_ends_with_the_sentences_in_the_dialogs_words(
    fake_engine: Callable[[str], Path], project: QgsProject, feedback: Recorder, tmp_path: Path
) -> None:
    fake_engine(
        "say(event='result', outputs={}, metrics={'zone_count': 3}, "
        "conclusion=['3 zones were found.', 'Give --cell for others.'])"
    )
    results, _ = run(project, feedback, OUTPUT_FOLDER=str(tmp_path))
    assert results["ZONE_COUNT"] == 3
    assert feedback.said("info")[-2:] == ["3 zones were found.", "Give “Cell size (m)” for others."]


@pytest.mark.parametrize(("count", "loaded"), [(2, ["Zones of coherent motion", "Displacement vectors"]), (0, [])])
def test_arrows_are_loaded_only_where_something_moves(
    fake_engine: Callable[[str], Path],
    project: QgsProject,
    feedback: Recorder,
    tmp_path: Path,
    count: int,
    loaded: list[str],
) -> None:
    fake_engine(ENGINE[: ENGINE.index('say(event="result"')] + MOTION.replace("COUNT", str(count)))
    wanted: dict[str, Any] = {
        name: to_load(QgsProcessing.TEMPORARY_OUTPUT, project)
        for name in ("VECTORS", "MOVING_ZONES", "SMALLEST_MOTION")
    }
    wanted["OUTPUT_FOLDER"] = str(tmp_path / "out")
    results, context = run(project, feedback, **wanted)
    assert {results[name] for name in ("VECTORS", "MOVING_ZONES")} == {str(tmp_path / "out" / "displacement.gpkg")}
    assert results["DISPLACEMENT_RASTER"] == str(tmp_path / "out" / "displacement.tif")
    assert results["MOVING_ZONE_COUNT"] == count
    load(context, wanted, feedback)
    group = project.layerTreeRoot().findGroup("SlopeWatch 2024-05-01 to 2025-05-01")
    shown = [(node.name(), node.itemVisibilityChecked()) for node in group.findLayers()]
    assert shown == [*((name, True) for name in loaded), ("Smallest motion that can be told (m)", False)]


def test_of_one_survey_only_the_screening_is_loaded(
    fake_engine: Callable[[str], Path], project: QgsProject, feedback: Recorder, tmp_path: Path
) -> None:
    only = 'outputs = {"screened_zones": outputs["zones"], "run": outputs["run"]}\n'
    fake_engine(ENGINE.replace('say(event="result"', only + 'say(event="result"'))
    wanted = {p.name: to_load(QgsProcessing.TEMPORARY_OUTPUT, project) for p in products.CHANGE_PRODUCTS}
    wanted |= {p.name: to_load(QgsProcessing.TEMPORARY_OUTPUT, project) for p in products.SCREENED_PRODUCTS}
    wanted |= {"OUTPUT_FOLDER": str(tmp_path / "out"), "CLOUD": None}
    results, context = run(project, feedback, **wanted)
    assert set(results) == {"OUTPUT_FOLDER", "SCREENED_ZONES", "RUN_RECORD", "ZONE_COUNT", "LOSS", "COMMON_CELL_RATE"}
    load(context, wanted, feedback)
    group = project.layerTreeRoot().findGroup("SlopeWatch 2024-05-01")
    assert [(node.name(), node.itemVisibilityChecked()) for node in group.findLayers()] == [("Screened zones", True)]
    assert len(project.mapLayers()) == 1


@pytest.mark.usefixtures("engine")
def test_products_chain_in_a_model(project: QgsProject, feedback: Recorder, tmp_path: Path) -> None:
    """Zones of a run go into another algorithm; the elevation change is an output of the model, to be loaded."""
    model = QgsProcessingModelAlgorithm("chain", "tests")
    for name in ("first", "later"):
        model.addModelParameter(QgsProcessingParameterFile(name, name), QgsProcessingModelParameter(name))
    inspect = QgsProcessingModelChildAlgorithm("slopewatch:inspectslope")
    inspect.setChildId("inspect")
    source = QgsProcessingModelChildParameterSource
    inspect.addParameterSources("REFERENCE", [source.fromModelParameter("first")])
    inspect.addParameterSources("CLOUD", [source.fromModelParameter("later")])
    change = QgsProcessingModelOutput("change")
    change.setChildId("inspect")
    change.setChildOutputName("ELEVATION_CHANGE")
    inspect.setModelOutputs({"change": change})
    model.addChildAlgorithm(inspect)
    extract = QgsProcessingModelChildAlgorithm("native:extractbyexpression")
    extract.setChildId("extract")
    extract.addParameterSources("INPUT", [source.fromChildOutput("inspect", "ZONES")])
    extract.addParameterSources("EXPRESSION", [source.fromStaticValue("\"kind\" = 'uplift'")])
    uplift = QgsProcessingModelOutput("uplift")
    uplift.setChildId("extract")
    uplift.setChildOutputName("OUTPUT")
    extract.setModelOutputs({"uplift": uplift})
    model.addChildAlgorithm(extract)
    model.updateDestinationParameters()
    assert model.validate()[0], model.validate()[1]

    context = QgsProcessingContext()
    context.setProject(project)
    parameters = {
        "first": FIRST,
        "later": LATER,
        "inspect:change": to_load(str(tmp_path / "dz.tif"), project),
        "extract:uplift": to_load(str(tmp_path / "uplift.gpkg"), project),
    }
    assert {p.name() for p in model.destinationParameterDefinitions()} == set(parameters) - {"first", "later"}
    results, ok = model.create().run(parameters, context, feedback, catchExceptions=False)
    assert ok, feedback.lines
    assert QgsVectorLayer(str(tmp_path / "uplift.gpkg"), "", "ogr").featureCount() == 2
    assert QgsRasterLayer(str(tmp_path / "dz.tif")).isValid()
    assert str(tmp_path / "dz.tif") in results.values()
    assert context.willLoadLayerOnCompletion(str(tmp_path / "dz.tif"))


def test_a_batch_writes_every_row(
    fake_engine: Callable[[str], Path], project: QgsProject, feedback: Recorder, tmp_path: Path
) -> None:
    """Rows as the batch dialog runs them: one parameter set after the other in one context."""
    fake_engine(ENGINE)
    context = QgsProcessingContext()
    context.setProject(project)
    algorithm = InspectSlope().create()
    for row in ("north", "south"):
        parameters = {
            "REFERENCE": FIRST,
            "CLOUD": LATER,
            "OUTPUT_FOLDER": str(tmp_path / row),
            "ZONES": to_load(str(tmp_path / f"{row}.gpkg"), project),
        }
        results, ok = algorithm.create().run(parameters, context, feedback)
        assert ok
        assert results["ZONES"] == str(tmp_path / f"{row}.gpkg")
    loaded = {f"{tmp_path}/{row}.gpkg|layername=zones" for row in ("north", "south")}
    assert set(context.layersToLoadOnCompletion()) == loaded
