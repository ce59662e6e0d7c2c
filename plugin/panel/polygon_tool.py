"""Drawing a polygon on the map: a left click sets a corner, a right or double click ends."""

from __future__ import annotations

from typing import Any

from qgis.core import Qgis, QgsGeometry, QgsPointXY
from qgis.gui import QgsMapCanvas, QgsMapTool, QgsRubberBand
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtGui import QColor


class PolygonTool(QgsMapTool):
    """Gives the polygon, in the map's reference system, by ``drawn``; ``given_up`` where it is left without one."""

    drawn = pyqtSignal(QgsGeometry)
    given_up = pyqtSignal()

    def __init__(self, canvas: QgsMapCanvas, colour: str) -> None:
        super().__init__(canvas)
        self.setCursor(Qt.CursorShape.CrossCursor)
        self._corners: list[QgsPointXY] = []
        self._band = QgsRubberBand(canvas, Qgis.GeometryType.Polygon)
        line, fill = QColor(colour), QColor(colour)
        fill.setAlpha(50)
        self._band.setStrokeColor(line)
        self._band.setFillColor(fill)
        self._band.setWidth(2)

    def canvasReleaseEvent(self, event: Any) -> None:
        if event.button() == Qt.MouseButton.RightButton:
            self.end()
        elif event.button() == Qt.MouseButton.LeftButton:
            point = event.mapPoint()
            if not self._corners or point != self._corners[-1]:
                self._corners.append(point)
            self._show(None)

    def canvasMoveEvent(self, event: Any) -> None:
        if self._corners:
            self._show(event.mapPoint())

    def canvasDoubleClickEvent(self, event: Any) -> None:
        # its first click has set the corner already
        self.end()

    def keyPressEvent(self, event: Any) -> None:
        if event.key() == Qt.Key.Key_Escape:
            self._clear()
            self.given_up.emit()
        elif event.key() in (Qt.Key.Key_Backspace, Qt.Key.Key_Delete) and self._corners:
            self._corners.pop()
            self._show(None)
        event.accept()

    def end(self) -> None:
        """Give the polygon of the corners so far; fewer than three are no polygon."""
        corners = list(self._corners)
        self._clear()
        if len(corners) < 3:
            self.given_up.emit()
        else:
            self.drawn.emit(QgsGeometry.fromPolygonXY([[*corners, corners[0]]]))

    def deactivate(self) -> None:
        self._clear()
        super().deactivate()

    def _show(self, pointed: QgsPointXY | None) -> None:
        self._band.reset(Qgis.GeometryType.Polygon)
        for corner in [*self._corners, *([pointed] if pointed is not None else [])]:
            self._band.addPoint(corner)

    def _clear(self) -> None:
        self._corners.clear()
        self._band.reset(Qgis.GeometryType.Polygon)
