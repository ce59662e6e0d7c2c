"""Layers and files that a dialog is given, as the engine gets them."""

from __future__ import annotations

from pathlib import Path

import pytest
from qgis.core import (
    QgsFeature,
    QgsGeometry,
    QgsPointCloudLayer,
    QgsProcessingException,
    QgsProcessingFeatureSourceDefinition,
    QgsProject,
    QgsVectorLayer,
)
from slopewatch.processing_algorithms.cloudinfo import CloudInfo
from slopewatch.processing_algorithms.elevationchange import ElevationChange
from slopewatch.processing_algorithms.extractground import ExtractGround
from slopewatch.processing_algorithms.inspectslope import InspectSlope
from slopewatch.processing_algorithms.registerepochs import RegisterEpochs
from slopewatch.processing_algorithms.writereport import WriteReport
from slopewatch.tests.builders.command_lines import command, square, written

pytestmark = pytest.mark.usefixtures("qgis_app")
FIRST, LATER = "/data/slope 2024-05-01.laz", "/data/slope 2025-05-01.laz"


def extent(path: str) -> tuple[float, float]:
    layer = QgsVectorLayer(path, "read", "ogr")
    assert layer.isValid()
    return layer.extent().xMinimum(), layer.extent().xMaximum()


def test_relative_paths_become_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = command(
        RegisterEpochs, REFERENCE="a.laz", CLOUD="b.laz", OUTPUT="c.laz", TRANSFORM="t.json", METHOD="none"
    )
    assert arguments == [
        "register", f"{tmp_path}/a.laz", f"{tmp_path}/b.laz", "--output", f"{tmp_path}/c.laz",
        "--transform", f"{tmp_path}/t.json", "--method", "none",
    ]  # fmt: skip


def test_a_polygon_file_is_passed_as_it_is(tmp_path: Path) -> None:
    roi = written(square("roi", 0), tmp_path / "roi.gpkg", "roi")
    arguments = command(ExtractGround, INPUT=FIRST, OUTPUT="/g.laz", ROI=str(roi))
    assert arguments[2:4] == ["--roi", str(roi)]


def test_a_layer_in_memory_is_exported() -> None:
    layer = square("roi", 500)
    QgsProject.instance().addMapLayer(layer)
    try:
        path = command(ExtractGround, INPUT=FIRST, OUTPUT="/g.laz", ROI=layer.id())[3]
        assert extent(path) == (500, 610)
        assert QgsVectorLayer(path, "", "ogr").crs().authid() == "EPSG:32651"
    finally:
        QgsProject.instance().removeMapLayer(layer.id())


def test_a_selection_is_exported(tmp_path: Path) -> None:
    layer = QgsVectorLayer(str(written(square("roi", 500), tmp_path / "roi.gpkg", "roi")), "roi", "ogr")
    QgsProject.instance().addMapLayer(layer)
    try:
        layer.selectByIds([1])
        chosen = QgsProcessingFeatureSourceDefinition(layer.id(), selectedFeaturesOnly=True)
        path = command(ExtractGround, INPUT=FIRST, OUTPUT="/g.laz", ROI=chosen)[3]
        assert extent(path) == (500, 510)
    finally:
        QgsProject.instance().removeMapLayer(layer.id())


def test_the_named_layer_of_several_is_taken(tmp_path: Path) -> None:
    path = written(square("other", 0), tmp_path / "all.gpkg", "other")
    written(square("roi", 500), path, "roi", append=True)
    arguments = command(ExtractGround, INPUT=FIRST, OUTPUT="/g.laz", ROI=f"{path}|layername=roi")
    assert extent(arguments[3]) == (500, 610)


def test_a_loaded_cloud_is_meant_by_its_name_or_id(tmp_path: Path) -> None:
    cloud = tmp_path / "2024-05-01.laz"
    cloud.touch()
    # not every QGIS opens clouds: the layer is there all the same
    layer = QgsProject.instance().addMapLayer(QgsPointCloudLayer(str(cloud), "survey in May", "copc"))
    try:
        for given in (layer.id(), "survey in May", str(cloud)):
            assert command(CloudInfo, INPUT=given)[:2] == ["info", str(cloud)]
        assert command(CloudInfo, INPUT="/data/other.laz")[:2] == ["info", "/data/other.laz"]
    finally:
        QgsProject.instance().clear()


def test_lines_of_profiles_reach_the_engine_as_a_file(tmp_path: Path) -> None:
    layer = QgsVectorLayer("LineString?crs=EPSG:32651", "lines", "memory")
    feature = QgsFeature()
    feature.setGeometry(QgsGeometry.fromWkt("LINESTRING(500000 3500000, 500030 3500010)"))
    layer.dataProvider().addFeature(feature)
    QgsProject.instance().addMapLayer(layer)
    folder = str(tmp_path / "results")
    assert command(WriteReport, INPUT=folder) == ["report", folder]
    assert command(WriteReport, INPUT=folder, PHOTOS="/data/site") == ["report", folder, "--photos", "/data/site"]
    for algorithm, inputs in (
        (WriteReport, {"INPUT": folder}),
        (ElevationChange, {"REFERENCE": FIRST, "CLOUD": LATER, "OUTPUT_FOLDER": folder}),
        (InspectSlope, {"REFERENCE": FIRST, "CLOUD": LATER, "OUTPUT_FOLDER": folder}),
    ):
        arguments = command(algorithm, PROFILES=layer.id(), ZONE_PROFILES=5, **inputs)
        assert arguments[-2:] == ["--zone-profiles", "5"]
        assert extent(arguments[arguments.index("--profiles") + 1]) == (500000, 500030)
    with pytest.raises(QgsProcessingException, match="INPUT is empty"):
        command(WriteReport, INPUT="")
