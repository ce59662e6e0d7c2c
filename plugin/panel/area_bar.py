"""The part of the panel that draws: the region, stable ground, and the quick top view to draw on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis.core import QgsApplication, QgsGeometry, QgsProject
from qgis.PyQt.QtCore import QSignalBlocker
from qgis.PyQt.QtWidgets import QFileDialog, QHBoxLayout, QLabel, QToolButton, QVBoxLayout, QWidget

from ..bridge.cloud_field import CloudField
from ..bridge.words import tr
from .areas import FILE, REGION, STABLE, AreaError, Kind, add_area
from .buttons import button
from .polygon_tool import PolygonTool

TOP_VIEW = "slopewatch:topview"
_CLOUDS = "Point clouds (*.las *.LAS *.laz *.LAZ)"


class AreaBar(QWidget):
    """``say`` shows a sentence, with True as a warning; ``open_dialog`` opens an algorithm's dialog with values."""

    def __init__(
        self, canvas: Any, say: Callable[[str, bool], None], open_dialog: Callable[[str, dict[str, Any]], None]
    ) -> None:
        super().__init__()
        self._canvas, self._say, self._open_dialog = canvas, say, open_dialog
        self._tool: PolygonTool | None = None
        self._before: Any = None
        self._buttons = {REGION.table: self._draw_button(REGION), STABLE.table: self._draw_button(STABLE)}
        self.cloud = CloudField(_CLOUDS)
        self.top_view = button(
            tr("Quick top view"), tr("A picture of the cloud from above, to draw on"), self._open_top_view
        )
        self._cloud_row = QWidget()
        row = QHBoxLayout(self._cloud_row)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(QLabel(tr("Cloud")))
        row.addWidget(self.cloud)
        row.addWidget(self.top_view)
        row = QHBoxLayout()
        for one in self._buttons.values():
            row.addWidget(one)
        row.addStretch()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._cloud_row)
        layout.addLayout(row)
        self.refresh()

    def refresh(self) -> None:
        """Offer the top view where the toolbox has it, of the clouds that are loaded."""
        self.cloud.refresh()
        self._cloud_row.setVisible(QgsApplication.processingRegistry().algorithmById(TOP_VIEW) is not None)

    def draw(self, kind: Kind) -> PolygonTool:
        """Begin to draw; what is drawn is kept as a layer."""
        tool = self.draw_for(kind.colour, lambda polygon: self._keep(kind, polygon))
        self._tick(kind, True)
        return tool

    def draw_for(self, colour: str, keep: Callable[[QgsGeometry], None]) -> PolygonTool:
        """Begin to draw a polygon that ``keep`` takes."""
        self.stop()
        self._before = self._canvas.mapTool()
        tool = PolygonTool(self._canvas, colour)
        tool.drawn.connect(lambda polygon: self._take(keep, polygon))
        tool.given_up.connect(self.stop)
        tool.deactivated.connect(self._untick)
        self._tool = tool
        self._canvas.setMapTool(tool)
        self._canvas.setFocus()
        return tool

    def _take(self, keep: Callable[[QgsGeometry], None], polygon: QgsGeometry) -> None:
        self.stop()
        keep(polygon)

    def stop(self) -> None:
        """Put back the tool that was active before."""
        tool, self._tool = self._tool, None
        if tool is not None and self._canvas.mapTool() is tool:
            self._canvas.unsetMapTool(tool)
            if self._before is not None:
                self._canvas.setMapTool(self._before)
        self._untick()

    def path(self) -> Path | None:
        """The file for the areas: in the project's folder, or where the user wants it; None if cancelled."""
        home = QgsProject.instance().homePath()
        if home:
            return Path(home) / FILE
        for layer in QgsProject.instance().mapLayers().values():
            if layer.customProperty("slopewatch/area"):
                return Path(layer.source().partition("|")[0])
        path, _ = QFileDialog.getSaveFileName(self, tr("File for what is drawn"), FILE, "GeoPackage (*.gpkg)")
        return Path(path if path.lower().endswith(".gpkg") else f"{path}.gpkg") if path else None

    def _keep(self, kind: Kind, polygon: QgsGeometry) -> None:
        crs = self._canvas.mapSettings().destinationCrs()
        path = self.path()
        if path is None:
            return
        try:
            layer = add_area(kind, polygon, path, QgsProject.instance(), crs)
        except AreaError as error:
            self._say(str(error), True)
            return
        self._say(
            tr("{} is kept in {} and chosen in the dialogs that SlopeWatch opens.").format(layer.name(), path), False
        )

    def _draw_button(self, kind: Kind) -> QToolButton:
        words, tip = tr("Draw region"), tr("Draw the outline of the slope: left click a corner, right click ends")
        if kind is STABLE:
            words = tr("Draw stable ground")
            tip = tr("Draw ground that has surely not moved, such as a wall or a road: right click ends")
        return button(words, tip, lambda: self._toggle(kind), "/mActionAddPolygon.svg", checkable=True)

    def _toggle(self, kind: Kind) -> None:
        if self._buttons[kind.table].isChecked():
            self.draw(kind)
        else:
            self.stop()

    def _tick(self, kind: Kind, on: bool) -> None:
        for table, one in self._buttons.items():
            blocker = QSignalBlocker(one)
            one.setChecked(on and table == kind.table)
            del blocker

    def _untick(self) -> None:
        self._tick(REGION, False)

    def _open_top_view(self) -> None:
        if self.cloud.path():
            self._open_dialog(TOP_VIEW, {"INPUT": self.cloud.path()})
        else:
            self._say(tr("Choose the cloud that the top view is to show."), True)
