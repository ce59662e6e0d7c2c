"""Drawing the region and stable ground: valid polygons in the map's reference system, offered to the dialogs."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from qgis.core import (
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsGeometry,
    QgsPointCloudLayer,
    QgsProject,
    QgsVectorLayer,
)
from qgis.gui import QgsMapMouseEvent
from qgis.PyQt.QtCore import QEvent, QPoint, Qt
from qgis.PyQt.QtGui import QKeyEvent
from slopewatch.plugin.panel import area_bar
from slopewatch.plugin.panel.areas import FILE, REGION, STABLE, AreaError, add_area, drawn_areas
from slopewatch.plugin.panel.dock import SlopeWatchPanel
from slopewatch.plugin.slopewatch_plugin import dialog_values

LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton
UTM = QgsCoordinateReferenceSystem("EPSG:32651")


@pytest.fixture
def project(tmp_path: Path) -> Iterator[QgsProject]:
    """A project that has been saved, so that it has a folder."""
    made = QgsProject.instance()
    made.setCrs(QgsCoordinateReferenceSystem("EPSG:32651"))
    assert made.write(str(tmp_path / "slope.qgz"))
    yield made
    made.clear()


def click(tool: Any, canvas: Any, x: int, y: int, button: Any = LEFT) -> None:
    released = QgsMapMouseEvent(canvas, QEvent.Type.MouseButtonRelease, QPoint(x, y), button, button)
    tool.canvasReleaseEvent(released)


def draw(panel: SlopeWatchPanel, kind: Any, *corners: tuple[int, int]) -> None:
    tool = panel.areas.draw(kind)
    for x, y in corners:
        click(tool, panel._canvas, x, y)
        tool.canvasMoveEvent(QgsMapMouseEvent(panel._canvas, QEvent.Type.MouseMove, QPoint(x + 5, y + 5)))
    click(tool, panel._canvas, 0, 0, RIGHT)


def square(west: float, size: float = 10.0) -> QgsGeometry:
    east = west + size
    return QgsGeometry.fromWkt(f"POLYGON(({west} 0, {east} 0, {east} {size}, {west} {size}, {west} 0))")


def test_a_region_lies_above_all_layers(project: QgsProject, tmp_path: Path) -> None:
    for group in ("simulated survey", "top view"):
        view = QgsVectorLayer("Polygon?crs=EPSG:32651", group, "memory")
        project.addMapLayer(view, False)
        project.layerTreeRoot().insertGroup(0, group).addLayer(view)
    drawn = [add_area(kind, square(0), tmp_path / FILE, project) for kind in (REGION, STABLE)]
    assert [node.layer() for node in project.layerTreeRoot().findLayers()][:2] == drawn[::-1]
    assert [node.parent() for node in project.layerTreeRoot().findLayers()][:2] == [project.layerTreeRoot()] * 2


def test_a_region_that_is_drawn_is_a_valid_polygon_in_the_maps_system(
    panel: SlopeWatchPanel, project: QgsProject, tmp_path: Path
) -> None:
    canvas = panel._canvas
    before = canvas.mapTool()
    draw(panel, REGION, (100, 50), (300, 50), (300, 250), (100, 250))
    layer = QgsVectorLayer(f"{tmp_path / FILE}|layername=region", "region", "ogr")
    assert layer.crs().authid() == "EPSG:32651"
    (feature,) = layer.getFeatures()
    shape = feature.geometry()
    assert shape.isGeosValid()
    to_map = canvas.getCoordinateTransform()
    corners = [to_map.toMapCoordinates(x, y) for x, y in ((100, 50), (300, 50), (300, 250), (100, 250))]
    expected = QgsGeometry.fromPolygonXY([[*corners, corners[0]]])
    assert shape.equals(expected)
    assert shape.area() == pytest.approx(200 * 200 * canvas.mapUnitsPerPixel() ** 2, rel=1e-6)
    with closing(sqlite3.connect(tmp_path / FILE)) as database:
        found = database.execute("SELECT srs_id, geometry_type_name FROM gpkg_geometry_columns").fetchall()
    assert found == [(32651, "POLYGON")]
    assert canvas.mapTool() is before or canvas.mapTool() is None
    assert str(tmp_path / FILE) in panel.sentence.text()


def test_what_was_drawn_is_offered_to_the_dialogs(
    panel: SlopeWatchPanel, project: QgsProject, tmp_path: Path, provider: Any
) -> None:
    first = add_area(REGION, square(0), tmp_path / FILE, project)
    second = add_area(REGION, square(50), tmp_path / FILE, project)
    wall = add_area(STABLE, square(100), tmp_path / FILE, project)
    assert add_area(STABLE, square(200), tmp_path / FILE, project) is wall
    assert (first.featureCount(), second.featureCount(), wall.featureCount()) == (1, 1, 2)
    assert drawn_areas(project) == {"ROI": second.id(), "STABLE": wall.id()}
    assert dialog_values("slopewatch:inspectslope", {"CELL": 0.2}) == {
        "CELL": 0.2, "ROI": second.id(), "STABLE": wall.id(),
    }  # fmt: skip
    assert dialog_values("slopewatch:extractground", {"ROI": "/other.gpkg"}) == {"ROI": "/other.gpkg"}
    assert dialog_values("slopewatch:checkenvironment", {}) == {}
    for name in ("ROI", "STABLE"):
        known = QgsApplication.processingRegistry().algorithmById("slopewatch:inspectslope")
        assert known.parameterDefinition(name).checkValueIsAcceptable(drawn_areas(project)[name])
    # a saved project still knows which they are
    assert project.write()
    path, name = project.fileName(), second.name()
    project.clear()
    assert project.read(path)
    assert project.mapLayer(drawn_areas(project)["ROI"]).name() == name


def test_stable_ground_in_another_map_is_moved_into_the_layers_system(project: QgsProject, tmp_path: Path) -> None:
    shape = QgsGeometry.fromWkt("POLYGON((500500 3500200, 500510 3500200, 500510 3500210, 500500 3500200))")
    layer = add_area(STABLE, shape, tmp_path / FILE, project)
    degrees = QgsCoordinateReferenceSystem("EPSG:4326")
    turned = QgsGeometry(shape)
    turned.transform(QgsCoordinateTransform(UTM, degrees, project))
    assert add_area(STABLE, turned, tmp_path / FILE, project, degrees) is layer
    one, two = (feature.geometry() for feature in layer.getFeatures())
    assert one.hausdorffDistance(two) < 0.01


@pytest.mark.parametrize(
    ("wkt", "words"),
    [
        ("POLYGON((0 0, 10 10, 10 0, 0 10, 0 0))", "crosses itself"),
        ("POLYGON((0 0, 10 0, 20 0, 0 0))", "no area"),
    ],
)
def test_what_is_no_area_is_refused(wkt: str, words: str, project: QgsProject, tmp_path: Path) -> None:
    with pytest.raises(AreaError, match=words):
        add_area(REGION, QgsGeometry.fromWkt(wkt), tmp_path / FILE, project)
    assert not (tmp_path / FILE).exists()


def test_a_map_without_a_system_and_a_folder_that_is_none_are_refused(project: QgsProject, tmp_path: Path) -> None:
    with pytest.raises(AreaError, match="no reference system"):
        add_area(REGION, square(0), tmp_path / FILE, project, QgsCoordinateReferenceSystem())
    (tmp_path / "file").touch()
    with pytest.raises(AreaError, match="cannot be written"):
        add_area(REGION, square(0), tmp_path / "file" / FILE, project)
    assert project.mapLayers() == {}


def test_drawing_can_be_corrected_and_given_up(panel: SlopeWatchPanel, project: QgsProject, tmp_path: Path) -> None:
    button = panel.areas._buttons["region"]
    button.click()
    tool = panel._canvas.mapTool()
    assert button.isChecked()
    for x, y in ((100, 50), (300, 50), (200, 10), (300, 250)):
        click(tool, panel._canvas, x, y)
        if (x, y) == (200, 10):
            tool.keyPressEvent(QKeyEvent(QEvent.Type.KeyPress, Qt.Key.Key_Backspace, Qt.KeyboardModifier.NoModifier))
    tool.canvasDoubleClickEvent(None)
    assert not button.isChecked()
    layer = project.mapLayer(drawn_areas(project)["ROI"])
    (feature,) = layer.getFeatures()
    assert sum(1 for _ in feature.geometry().vertices()) == 4, "three corners and the first again"
    button.click()
    tool = panel._canvas.mapTool()
    click(tool, panel._canvas, 100, 50)
    tool.keyPressEvent(QKeyEvent(QEvent.Type.KeyPress, Qt.Key.Key_Escape, Qt.KeyboardModifier.NoModifier))
    assert not button.isChecked()
    draw(panel, STABLE, (10, 10), (20, 20))
    assert list(drawn_areas(project)) == ["ROI"]


def test_the_top_view_is_offered_where_the_toolbox_has_it(
    panel: SlopeWatchPanel, opened: list[Any], monkeypatch: pytest.MonkeyPatch, warnings: list[str], tmp_path: Path
) -> None:

    class Registry:
        def __init__(self, algorithm: Any) -> None:
            self._algorithm = algorithm

        def algorithmById(self, name: str) -> Any:
            assert name == "slopewatch:topview"
            return self._algorithm

    for algorithm in (None, object()):
        monkeypatch.setattr(
            area_bar.QgsApplication, "processingRegistry", lambda algorithm=algorithm: Registry(algorithm)
        )
        panel.areas.refresh()
        assert panel.areas._cloud_row.isHidden() == (algorithm is None)
    panel.areas.top_view.click()
    assert opened == []
    assert "Choose the cloud" in warnings[0]
    cloud = tmp_path / "2024-05-01.laz"
    cloud.touch()
    panel.areas.cloud.set_path("/data/2024-05-01.laz")
    QgsProject.instance().addMapLayer(QgsPointCloudLayer(str(cloud), "loaded later", "copc"))
    assert panel.areas.cloud.box.itemData(panel.areas.cloud.box.findText("loaded later")) == str(cloud)
    panel.areas.top_view.click()
    assert opened == [("slopewatch:topview", {"INPUT": "/data/2024-05-01.laz"})]
