"""Run inside QGIS by ``qgis --code``: the panel at work on a run of two surveys and on a series, with pictures.

Its task is described in qgis_session.py; its parameters are RUN and, if wanted, SERIES, two output folders.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis.core import QgsProject, QgsRasterLayer
from qgis.PyQt.QtCore import QCoreApplication, QPoint, Qt
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QDockWidget
from qgis.utils import iface
from slopewatch.lab.sessions.qgis_session import REPORT, TASK, QgisSession

_MAPS = {
    "TOP": ("top_view.tif", "Top view"),
    "CHANGE": ("elevation_change.tif", "Elevation change (m)"),
}


class PanelSession(QgisSession):
    _panel: Any = None

    def steps(self) -> list[Callable[[], bool | None]]:
        return [
            self.open_window,
            self.load_map,
            self.draw_map,
            self.open_panel,
            self.review,
            self.draw_zone,
            self.pick_zone,
            self.draw_region,
            self.look_at_region,
            self.look_at_menu,
            self.open_series,
            self.look_at_series,
            self.finish,
        ]

    def load_map(self) -> None:
        for name, title in _MAPS.values():
            layer = QgsRasterLayer(str(Path(TASK["parameters"]["RUN"]) / name), title)
            QgsProject.instance().addMapLayer(layer)

    def draw_map(self) -> bool:
        if not self.drawn("Elevation change (m)"):
            return True
        self.picture("masked", iface.mapCanvas())
        self._waited = 0
        return False

    def open_panel(self) -> None:
        window = iface.mainWindow()
        self._panel = window.findChild(QDockWidget, "SlopeWatchPanel")
        self._panel.toggleViewAction().trigger()
        self._panel.load_run(Path(TASK["parameters"]["RUN"]))
        window.resizeDocks([self._panel], [480], Qt.Orientation.Horizontal)
        REPORT["zones"] = [row.name for row in self._panel.zones.model.rows]

    def review(self) -> None:
        panel = self._panel
        panel.reviews.reviewer.setText("A. Sato")
        rows = panel.zones.model.rows
        for number, state in ((0, "confirmed"), (len(rows) - 1, "rejected")):
            panel.zones.choose(rows[number].feature)
            panel.reviews.enter(state)
        panel.reviews.enter_remark("cut grass")
        panel.zones.choose(rows[0].feature)
        QCoreApplication.processEvents()
        panel.zones.choose(panel.zones.model.rows[1].feature)
        panel.zoom()
        self._waited = 1

    def draw_zone(self) -> bool:
        if not self.drawn(""):
            return True
        self.picture("panel")
        self.picture("dock", self._panel)
        REPORT["saved"] = self._panel.reviews.keep()
        return False

    def pick_zone(self) -> None:
        """Choose the zone in the middle of the map by a click, with another one chosen before."""
        panel = self._panel
        expected = panel.zones.current().name
        panel.zones.choose(panel.zones.model.rows[-1].feature)
        REPORT["tool_before"] = type(iface.mapCanvas().mapTool()).__name__
        panel.pick_button.click()
        self.click(0.5, 0.5)
        REPORT["picked"] = [expected, panel.zones.current().name]
        panel.pick_button.click()
        REPORT["picking"] = panel.pick_button.isChecked()
        REPORT["tool_after"] = type(iface.mapCanvas().mapTool()).__name__

    def draw_region(self) -> None:
        QgsProject.instance().write(str(Path(TASK["images"]) / "slope.qgz"))  # areas lie next to a project
        self._panel.areas._buttons["region"].click()
        for across, down in ((0.2, 0.2), (0.8, 0.25), (0.75, 0.8), (0.25, 0.7)):
            self.click(across, down)
        self.click(0.5, 0.5, Qt.MouseButton.RightButton)

    def look_at_region(self) -> None:
        layers = [
            layer for layer in QgsProject.instance().mapLayers().values() if layer.customProperty("slopewatch/area")
        ]
        REPORT["drawn"] = [
            {
                "crs": layer.crs().authid(),
                "source": layer.source(),
                "corners": [sum(1 for _ in f.geometry().vertices()) for f in layer.getFeatures()],
                "share": sum(f.geometry().area() for f in layer.getFeatures()) / iface.mapCanvas().extent().area(),
            }
            for layer in layers
        ]
        self.picture("region")

    def click(self, across: float, down: float, button: Any = Qt.MouseButton.LeftButton) -> None:
        """Click on the map, at shares of its width and height."""
        view = iface.mapCanvas().viewport()
        place = QPoint(round(across * view.width()), round(down * view.height()))
        QTest.mouseMove(view, place)
        QTest.mouseClick(view, button, Qt.KeyboardModifier.NoModifier, place)
        QCoreApplication.processEvents()

    def look_at_menu(self) -> None:
        REPORT["tools"] = {
            entry.menu().title(): [tool.text() for tool in entry.menu().actions()]
            for menu in (a.menu() for a in iface.pluginMenu().actions() if a.text() == "SlopeWatch" and a.menu())
            for entry in menu.actions()
            if entry.menu() is not None
        }

    def open_series(self) -> None:
        if "SERIES" not in TASK["parameters"]:
            return
        self._panel.load_run(Path(TASK["parameters"]["SERIES"]))
        self._panel.zones.choose(self._panel.zones.model.rows[0].feature)

    def look_at_series(self) -> None:
        self.picture("series_dock", self._panel)


PanelSession.begin()
