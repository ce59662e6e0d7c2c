"""Run inside QGIS by ``qgis --code``: *Top view* from its dialog, its layers, and the dialogs of what draws on it.

Its task is described in qgis_session.py; its parameters are those of topview.
"""

from __future__ import annotations

from collections.abc import Callable

from qgis import processing
from qgis.core import QgsProject
from qgis.PyQt.QtWidgets import QDockWidget
from qgis.utils import iface
from slopewatch.lab.sessions.qgis_session import REPORT, QgisSession

PICTURE, HILLSHADE = "Top view", "Hillshade"
OTHERS = ("suggestroi", "exportlabelstudio", "importlabelstudio")


class DrawingSession(QgisSession):
    ALGORITHM = "slopewatch:topview"

    def steps(self) -> list[Callable[[], bool | None]]:
        return [
            self.open_window,
            self.open_dialog,
            self.look_at_dialog,
            self.run,
            self.wait_for_result,
            self.show_log,
            self.show_picture,
            self.show_hillshade,
            *[lambda name=name: self.look_at(name) for name in OTHERS],
            self.finish,
        ]

    def show_picture(self) -> bool:
        """The map as the run leaves it."""
        if not self._waited:
            iface.mainWindow().findChild(QDockWidget, "ProcessingToolbox").hide()
        if not self.drawn(PICTURE):
            return True
        self.report_layers()
        self.picture("picture_map", iface.mapCanvas())
        self._waited = 0
        return False

    def show_hillshade(self) -> bool:
        if not self._waited:
            for name, shown in ((PICTURE, False), (HILLSHADE, True)):
                for layer in QgsProject.instance().mapLayersByName(name):
                    QgsProject.instance().layerTreeRoot().findLayer(layer.id()).setItemVisibilityChecked(shown)
        if not self.drawn(HILLSHADE):
            return True
        self.picture("hillshade_map", iface.mapCanvas())
        return False

    def look_at(self, name: str) -> None:
        """The dialog of an algorithm, empty."""
        dialog = processing.createAlgorithmDialog(f"slopewatch:{name}", {})
        dialog.show()
        dialog.resize(1040, 800)
        self.picture(name, dialog)
        REPORT.setdefault("titles", []).append(dialog.windowTitle())
        dialog.close()


DrawingSession.begin()
