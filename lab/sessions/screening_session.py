"""Run inside QGIS by ``qgis --code``: *Screen for hazards* from its dialog, its layers on the map, pictures of them.

Its task is described in qgis_session.py; its parameters are those of screenhazards.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from qgis.core import QgsProject
from qgis.PyQt.QtWidgets import QDockWidget
from qgis.utils import iface
from slopewatch.lab.sessions.qgis_session import REPORT, QgisSession

ZONES, PROBABILITY = "Hazard zones (screening)", "Probability of a hazard"


class ScreeningSession(QgisSession):
    ALGORITHM = "slopewatch:screenhazards"
    _pressed = 0.0

    def steps(self) -> list[Callable[[], bool | None]]:
        return [
            self.open_window,
            self.open_dialog,
            self.look_at_dialog,
            self.run,
            self.wait_for_result,
            self.show_log,
            self.show_zones,
            self.show_probability,
            self.show_table,
            self.finish,
        ]

    def run(self) -> None:
        self._pressed = time.monotonic()
        super().run()

    def show_log(self) -> None:
        REPORT["seconds"] = self._ended - self._pressed
        super().show_log()

    def show_zones(self) -> bool:
        """The map as the run leaves it."""
        if not self._waited:
            iface.mainWindow().findChild(QDockWidget, "ProcessingToolbox").hide()
        if not self.drawn(PROBABILITY):
            return True
        self.report_layers()
        canvas = iface.mapCanvas()
        extent = canvas.extent()
        REPORT["extent"] = [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()]
        self.picture("zones_map", canvas)
        self._waited = 0
        return False

    def show_probability(self) -> bool:
        if not self._waited:
            for layer in QgsProject.instance().mapLayersByName(PROBABILITY):
                node = QgsProject.instance().layerTreeRoot().findLayer(layer.id())
                node.setItemVisibilityChecked(True)
                node.setExpanded(True)
        if not self.drawn(PROBABILITY):
            return True
        self.picture("layers")
        self.picture("map", iface.mapCanvas())
        return False

    def show_table(self) -> None:
        self.table_of(ZONES, "table")


ScreeningSession.begin()
