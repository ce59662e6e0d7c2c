"""What is handed over, by the real qgis_process, read back by QGIS, by its GDAL and by the schema of the metadata."""

from __future__ import annotations

import importlib.util
import json
import warnings
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from qgis.core import QgsProject, QgsRasterLayer, QgsVectorLayer, QgsWkbTypes
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.qgis import QgisProcess, engine_python

_SCHEMA = "plugins/profiles/apiso/schemas/ogc/iso/19139/20070417/gmd/gmd.xsd"


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    engine_python()
    return Inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def given(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("given, 'it'")
    names = folder / "names.csv"
    names.write_text("ours,theirs\nzone_id,ASSET REF\nkind,Change Kind\n", encoding="utf-8")
    more = [
        "--surface-points",
        "400",
        "--fields",
        names,
        "--organisation",
        "Agency <A & B>",
        "--email",
        "a@example.org",
    ]
    inputs.engine("exportgis", inputs.change, *more, "--output", folder / "out")
    return folder / "out"


def layer_of(path: Path, name: str = "") -> QgsVectorLayer:
    layer = QgsVectorLayer(f"{path}|layername={name}" if name else str(path), path.stem, "ogr")
    assert layer.isValid(), path
    return layer


def sorted_areas(layer: QgsVectorLayer) -> list[float]:
    return sorted(feature.geometry().area() for feature in layer.getFeatures())


def test_the_toolbox_hands_over_in_one_archive(qgis_process: QgisProcess, inputs: Inputs, tmp_path: Path) -> None:
    results = qgis_process.run(
        "exportgis", INPUT=inputs.change, FORMATS="gpkg,geojson", OUTPUT=tmp_path / "to, 'them'.zip"
    )
    with zipfile.ZipFile(results["OUTPUT"]) as archive:
        assert "layers.gpkg" in archive.namelist()
        assert results["FILES"] == len(archive.namelist())
    done = qgis_process.attempt("exportgis", INPUT=tmp_path, OUTPUT=tmp_path / "b.zip")
    assert done.returncode == 1
    assert "holds no run.json, so no finished run" in done.stderr


def test_every_raster_and_its_style_load(given: Path) -> None:
    rasters = sorted((given / "rasters").glob("*.tif"))
    assert len(rasters) >= 6
    for path in rasters:
        layer = QgsRasterLayer(str(path), path.stem)
        assert layer.isValid()
        assert layer.crs().authid() == "EPSG:32651"
        style = path.with_suffix(".qml")
        if style.is_file():
            message, sound = layer.loadNamedStyle(str(style))
            assert sound, (style, message)
            assert layer.renderer().type() == ("paletted" if path.stem == "seen" else "singlebandpseudocolor")


def test_a_rasters_descriptor_has_the_colours_that_qgis_writes_of_its_style(given: Path, tmp_path: Path) -> None:
    """QGIS reads no descriptors of rasters, but writes them."""
    descriptors = sorted((given / "rasters").glob("*.sld"))
    assert len(descriptors) >= 4
    for path in descriptors:
        layer = QgsRasterLayer(str(path.with_suffix(".tif")), path.stem)
        layer.loadNamedStyle(str(path.with_suffix(".qml")))
        layer.saveSldStyle(str(tmp_path / path.name))
        ours, theirs = (
            [
                (float(entry.get("quantity")), entry.get("color").lower(), float(entry.get("opacity", 1)))
                for entry in ElementTree.parse(file).getroot().iter("{http://www.opengis.net/sld}ColorMapEntry")
            ]
            for file in (path, tmp_path / path.name)
        )
        assert len(ours) == len(theirs) >= 2
        for one, other in zip(ours, theirs):
            assert one[1] == other[1]
            assert one[::2] == pytest.approx(other[::2], abs=0.005)


def test_layers_are_the_same_in_every_format(inputs: Inputs, given: Path) -> None:
    ours = layer_of(inputs.change / "zones.gpkg", "zones")
    areas = sorted_areas(ours)
    package = layer_of(given / "layers.gpkg", "zones")
    assert sorted_areas(package) == pytest.approx(areas, rel=1e-9)
    assert {"ASSET REF", "Change Kind"} <= set(package.fields().names())
    assert package.labeling() is not None, "the style inside is loaded"
    ids = sorted(feature["ASSET REF"] for feature in package.getFeatures())
    assert ids == sorted(feature["zone_id"] for feature in ours.getFeatures())
    for path in (given / "geojson" / "zones.geojson", given / "kml" / "zones.kml"):
        layer = layer_of(path)
        assert layer.crs().authid() in ("EPSG:4326", "OGC:CRS84")
        assert layer.featureCount() == len(areas)
        extent = layer.extent()
        assert 100 < extent.xMinimum() < extent.xMaximum() < 140
    raised = layer_of(given / "kml" / "zones_heights.kml")
    assert QgsWkbTypes.hasZ(next(raised.getFeatures()).geometry().wkbType())
    table = QgsVectorLayer(
        f"{(given / 'csv' / 'zones.csv').as_uri()}?type=csv&delimiter=,&wktField=wkt&crs=EPSG:32651",
        "t",
        "delimitedtext",
    )
    assert table.isValid()
    assert sorted_areas(table) == pytest.approx(areas, abs=0.05)


def test_what_was_not_seen_is_hatched_by_style_and_by_descriptor(given: Path) -> None:
    for load, ending in (("loadNamedStyle", "qml"), ("loadSldStyle", "sld")):
        layer = layer_of(given / "layers.gpkg", "not_seen")
        message, sound = getattr(layer, load)(str(given / "styles" / f"not_seen.{ending}"))
        assert sound, message
        kinds = [part.layerType() for part in layer.renderer().symbol().symbolLayers()]
        assert kinds == ["SimpleFill", "LinePatternFill"]


def test_a_layers_descriptor_sorts_its_features_as_its_style(given: Path) -> None:
    counts = []
    for load, ending in (("loadNamedStyle", "qml"), ("loadSldStyle", "sld")):
        layer = layer_of(given / "layers.gpkg", "zones")
        message, sound = getattr(layer, load)(str(given / "styles" / f"zones.{ending}"))
        assert sound, message
        renderer = layer.renderer()
        if ending == "qml":
            found = {}
            expression = renderer.classAttribute()
            assert "Change Kind" in expression
            for feature in layer.getFeatures():
                label = f"{feature['Change Kind']}, {feature['severity']}".capitalize()
                found[label] = found.get(label, 0) + 1
        else:
            assert renderer.type() == "RuleRenderer"
            found = {}
            for rule in renderer.rootRule().children():
                if rule.symbol() is None:
                    continue
                count = sum(1 for _ in layer.getFeatures(rule.filterExpression()))
                if count:
                    found[rule.label()] = count
        counts.append(found)
    assert counts[0] == counts[1]
    assert sum(counts[0].values()) == layer.featureCount()


def test_the_drawing_has_its_layers_and_heights(inputs: Inputs, given: Path) -> None:
    drawing = layer_of(given / "cad" / "drawing.dxf", "entities")
    counts: dict[str, int] = {}
    texts = set()
    for feature in drawing.getFeatures():
        counts[feature["Layer"]] = counts.get(feature["Layer"], 0) + 1
        if feature["Text"]:
            texts.add(feature["Text"])
        assert QgsWkbTypes.hasZ(feature.geometry().wkbType()) or feature["Text"]
    assert {"GROUND_2024-05-01", "GROUND_2025-05-01", "SECTIONS_EARLIER", "SECTIONS_LATER"} <= set(counts)
    assert counts["GROUND_2024-05-01"] > 300
    zones = layer_of(inputs.change / "zones.gpkg", "zones")
    assert texts == {feature["zone_id"] for feature in zones.getFeatures()}
    extent, expected = drawing.extent(), zones.extent()
    assert extent.contains(expected)


def test_the_metadata_keep_to_their_schema(given: Path) -> None:
    found = importlib.util.find_spec("pycsw")
    etree = pytest.importorskip("lxml.etree")
    if found is None or found.origin is None:
        pytest.skip("the schema of ISO 19139 is not installed (python -m pip install --no-deps pycsw)")
    schema = etree.XMLSchema(etree.parse(str(Path(found.origin).parent / _SCHEMA)))
    document = etree.parse(str(given / "metadata" / "iso19139.xml"))
    assert schema.validate(document), schema.error_log
    document.getroot().remove(document.getroot().find("{*}contact"))
    assert not schema.validate(document), "the schema has to ask for something"


def test_the_metadata_are_read_by_another_library(given: Path) -> None:
    iso = pytest.importorskip("owslib.iso")
    etree = pytest.importorskip("lxml.etree")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of the library's next version
        read = iso.MD_Metadata(etree.parse(str(given / "metadata" / "iso19139.xml")).getroot())
    assert read.contact[0].organization == "Agency <A & B>"
    assert read.referencesystem.code == "32651"
    # called identificationinfo until version 0.35 of the library, in which both are lists
    (identification,) = getattr(read, "identificationinfo", None) or read.identification
    assert identification.temporalextent_start == "2024-05-01"
    assert identification.temporalextent_end == "2025-05-01"
    item = json.loads((given / "item.json").read_text(encoding="utf-8"))
    box = identification.extent.boundingBox
    assert [float(v) for v in (box.minx, box.miny, box.maxx, box.maxy)] == item["bbox"]


@pytest.fixture(autouse=True)
def _empty_project(qgis_app: object) -> None:
    QgsProject.instance().clear()
