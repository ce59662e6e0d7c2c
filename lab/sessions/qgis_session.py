"""What the sessions have in common that ``qgis --code`` runs inside QGIS: steps in order, pictures, the report.

The environment variable SLOPEWATCH_DESKTOP names a JSON file with ``parameters`` (of the algorithm), ``images`` (folder
for the pictures), ``report`` (file to write) and ``seconds`` (limit).
"""

from __future__ import annotations

import json
import os
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis import processing
from qgis.core import Qgis, QgsApplication, QgsProject
from qgis.PyQt.QtCore import QCoreApplication, QPoint, Qt, QTimer
from qgis.PyQt.QtWidgets import QApplication, QDockWidget, QTextEdit
from qgis.utils import iface, plugins

TASK = json.loads(Path(os.environ["SLOPEWATCH_DESKTOP"]).read_text(encoding="utf-8"))
REPORT: dict[str, Any] = {"errors": [], "messages": [], "pictures": []}


class QgisSession(ABC):
    """The steps in order; each is called once the event loop is quiet, and may ask to be called again."""

    ALGORITHM = ""
    _running: QgisSession

    def __init__(self) -> None:
        self._steps = self.steps()
        self._finished: dict[str, Any] | None = None
        self._dialog: Any = None
        self._waited = 0
        self._ended = 0.0
        QgsApplication.messageLog().messageReceived[str, str, Qgis.MessageLevel].connect(self.message)

    @classmethod
    def begin(cls) -> None:
        Path(TASK["report"]).touch()  # the session has begun
        QgisSession._running = session = cls()
        QTimer.singleShot(int(TASK["seconds"] * 1000), session.give_up)
        QTimer.singleShot(1500, session.advance)

    @abstractmethod
    def steps(self) -> list[Callable[[], bool | None]]:
        """The session, in order; a step that returns True is called again."""

    def message(self, text: str, tag: str, level: Any) -> None:
        if level in (Qgis.MessageLevel.Warning, Qgis.MessageLevel.Critical):
            REPORT["messages"].append(f"{tag}: {text}")

    def advance(self) -> None:
        try:
            again = self._steps[0]()
        except Exception:
            REPORT["errors"].append(traceback.format_exc())
            self.picture("failed")
            self.finish()
            return
        if not again:
            self._steps.pop(0)
        QTimer.singleShot(200 if again else 500, self.advance)

    # --- steps --------------------------------------------------------------------------------------------------

    def open_window(self) -> None:
        window = iface.mainWindow()
        screen = QApplication.primaryScreen().availableGeometry()
        window.setGeometry(screen)
        window.showMaximized()
        iface.newProject()
        for dock in window.findChildren(QDockWidget):
            if dock.objectName() in ("Browser", "LayerOrder", "undo/redo dock", "LayerStyling"):
                dock.hide()
        layers = window.findChild(QDockWidget, "Layers")
        window.resizeDocks([layers], [380], Qt.Orientation.Horizontal)
        REPORT["loaded"] = "slopewatch" in plugins
        REPORT["menu"] = [a.text() for a in iface.pluginMenu().actions() if "SlopeWatch" in a.text()]

    def open_dialog(self) -> None:
        self._dialog = processing.createAlgorithmDialog(self.ALGORITHM, TASK["parameters"])
        self._dialog.algorithmFinished.connect(self._on_finished)
        self._dialog.show()
        self._dialog.resize(1040, 800)
        self._dialog.move(QPoint(60, 60))

    def look_at_dialog(self) -> None:
        self.picture("dialog", self._dialog)

    def run(self) -> None:
        self._dialog.runButton().click()

    def wait_for_result(self) -> bool:
        return self._finished is None

    def show_log(self) -> None:
        REPORT["finished"] = self._finished
        REPORT["log"] = self._dialog.findChild(QTextEdit, "txtLog").toPlainText()
        self.picture("log", self._dialog)
        self._dialog.close()

    def finish(self) -> None:
        Path(TASK["report"]).write_text(json.dumps(REPORT, indent=1, default=str), encoding="utf-8")
        os._exit(1 if REPORT["errors"] else 0)

    def give_up(self) -> None:
        REPORT["errors"].append(f"not finished within {TASK['seconds']} s, at {self._steps[0].__name__}")
        self.picture("failed")
        self.finish()

    # --- helpers ------------------------------------------------------------------------------------------------

    def drawn(self, name: str) -> bool:
        """Bring the layer's extent on the map at the first call; gives whether the map has been drawn by now."""
        canvas = iface.mapCanvas()
        if not self._waited:
            layers = QgsProject.instance().mapLayersByName(name)
            if layers:
                canvas.setDestinationCrs(layers[0].crs())
                extent = layers[0].extent()
                extent.scale(1.08)
                canvas.setExtent(extent)
                canvas.refresh()
        self._waited += 1
        return not canvas.isDrawing() and self._waited >= 8

    def report_layers(self) -> None:
        REPORT["layers"] = [
            {
                "name": node.name(),
                "group": node.parent().name(),
                "visible": node.itemVisibilityChecked(),
                "expanded": node.isExpanded(),
                "renderer": node.layer().renderer().type(),
                "valid": node.layer().isValid(),
                "source": node.layer().source(),
                "crs": node.layer().crs().authid(),
            }
            for node in QgsProject.instance().layerTreeRoot().findLayers()
        ]
        REPORT["crs"] = iface.mapCanvas().mapSettings().destinationCrs().authid()

    def table_of(self, name: str, picture: str) -> None:
        layers = QgsProject.instance().mapLayersByName(name)
        if layers:
            table = iface.showAttributeTable(layers[0])
            table.window().resize(1300, 320)
            QCoreApplication.processEvents()
            self.picture(picture, table)
            table.close()

    def _on_finished(self, successful: bool, results: dict[str, Any]) -> None:
        self._ended = time.monotonic()
        self._finished = {"successful": successful, "results": {k: str(v) for k, v in results.items()}}

    def picture(self, name: str, widget: Any = None) -> None:
        """Save what the screen shows, or one widget."""
        iface.messageBar().clearWidgets()
        QCoreApplication.processEvents()
        image = QApplication.primaryScreen().grabWindow(0) if widget is None else widget.grab()
        path = str(Path(TASK["images"]) / f"{name}.png")
        image.save(path)
        REPORT["pictures"].append(path)
