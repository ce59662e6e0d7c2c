"""Run inside QGIS by ``qgis --code``: use the plugin as an analyst does, take pictures, write a report, leave.

The environment variable SLOPEWATCH_DESKTOP names a JSON file with ``parameters`` (of inspectslope), ``images`` (folder
for the pictures), ``report`` (file to write) and ``seconds`` (limit).
"""

from __future__ import annotations

import json
import os
import time
import traceback
from pathlib import Path
from typing import Any

from qgis import processing
from qgis.core import Qgis, QgsApplication, QgsProject
from qgis.PyQt.QtCore import QCoreApplication, QPoint, Qt, QTimer
from qgis.PyQt.QtWidgets import QApplication, QDockWidget, QTextEdit, QTreeView
from qgis.utils import iface, plugins

TASK = json.loads(Path(os.environ["SLOPEWATCH_DESKTOP"]).read_text(encoding="utf-8"))
REPORT: dict[str, Any] = {"errors": [], "messages": [], "pictures": []}


class Session:
    """The steps in order; each is called once the event loop is quiet, and may ask to be called again."""

    def __init__(self) -> None:
        self._steps = [
            self.open_window,
            self.open_toolbox,
            self.begin_and_cancel,
            self.wait_until_cancelled,
            self.open_batch,
            self.open_dialog,
            self.look_at_dialog,
            self.run,
            self.wait_for_result,
            self.show_log,
            self.show_map,
            self.show_zone,
            self.look_at_settings,
            self.finish,
        ]
        self._finished: dict[str, Any] | None = None
        self._dialog: Any = None
        self._waited = 0
        self._pressed = self._ended = 0.0
        QgsApplication.messageLog().messageReceived[str, str, Qgis.MessageLevel].connect(self.message)

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

    def open_toolbox(self) -> None:
        toolbox = iface.mainWindow().findChild(QDockWidget, "ProcessingToolbox")
        toolbox.show()
        toolbox.raise_()
        tree = toolbox.findChild(QTreeView)
        model, found = tree.model(), []

        def walk(parent: Any, path: str) -> None:
            for row in range(model.rowCount(parent)):
                index = model.index(row, 0, parent)
                name = f"{path}/{index.data()}"
                if name.startswith("/SlopeWatch"):
                    tree.expand(index)
                    tree.scrollTo(index)
                    found.append(name)
                    walk(index, name)

        walk(tree.rootIndex(), "")
        REPORT["toolbox"] = found
        iface.mainWindow().resizeDocks([toolbox], [260], Qt.Orientation.Horizontal)
        self.picture("toolbox", toolbox)

    def begin_and_cancel(self) -> bool:
        """Start a long run and press Cancel once the engine is at work."""
        folder = Path(str(TASK["parameters"]["OUTPUT_FOLDER"]) + "-cancelled")
        if self._dialog is None:
            parameters = {**TASK["parameters"], "OUTPUT_FOLDER": str(folder), "CLOTH_RESOLUTION": 0.02}
            self._dialog = processing.createAlgorithmDialog("slopewatch:inspectslope", parameters)
            self._dialog.algorithmFinished.connect(self._on_finished)
            self._dialog.show()
            self._dialog.runButton().click()
        if not list(folder.glob(".slopewatch-part-*")):
            return self._finished is None
        self._dialog.cancelButton().click()
        self._pressed = time.monotonic()
        return False

    def wait_until_cancelled(self) -> bool:
        if self._finished is None:
            return True
        REPORT["cancelled"] = {
            "seconds": self._ended - self._pressed,
            "successful": self._finished["successful"],
            "log": self._dialog.findChild(QTextEdit, "txtLog").toPlainText(),
            "left": os.path.exists(str(TASK["parameters"]["OUTPUT_FOLDER"]) + "-cancelled"),
        }
        self._finished = None
        self._dialog.close()
        return False

    def open_batch(self) -> None:
        from processing.gui.BatchAlgorithmDialog import BatchAlgorithmDialog

        algorithm = QgsApplication.processingRegistry().createAlgorithmById("slopewatch:inspectslope")
        dialog = BatchAlgorithmDialog(algorithm, parent=iface.mainWindow())
        dialog.resize(1300, 420)
        dialog.show()
        self.picture("batch", dialog)
        dialog.close()

    def open_dialog(self) -> None:
        self._dialog = processing.createAlgorithmDialog("slopewatch:inspectslope", TASK["parameters"])
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

    def show_map(self) -> bool:
        canvas = iface.mapCanvas()
        if not self._waited:
            toolbox = iface.mainWindow().findChild(QDockWidget, "ProcessingToolbox")
            toolbox.show()
            layers = QgsProject.instance().mapLayersByName("Elevation change (m)")
            if layers:
                canvas.setDestinationCrs(layers[0].crs())
                extent = layers[0].extent()
                extent.scale(1.08)
                canvas.setExtent(extent)
                canvas.refresh()
        self._waited += 1
        if canvas.isDrawing() or self._waited < 8:
            return True
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
        REPORT["crs"] = canvas.mapSettings().destinationCrs().authid()
        self.picture("desktop")
        self.picture("map", canvas)
        return False

    def show_zone(self) -> None:
        zones = QgsProject.instance().mapLayersByName("Hazard zones")
        if zones:
            table = iface.showAttributeTable(zones[0])
            table.window().resize(1300, 320)
            QCoreApplication.processEvents()
            self.picture("zones", table)
            table.close()

    def look_at_settings(self) -> None:
        def check() -> None:
            from slopewatch.plugin.settings_page import SettingsPage

            options = QApplication.activeModalWidget()
            if options is None:
                return
            page = options.findChild(SettingsPage)
            REPORT["settings"] = page is not None and page.isVisible()
            if page is not None:
                page.check_button.click()
                REPORT["check"] = page.report.toPlainText()
                options.resize(1000, 640)
                QCoreApplication.processEvents()
                self.picture("settings", options)
            options.reject()

        QTimer.singleShot(1500, check)
        plugins["slopewatch"].open_settings()

    def finish(self) -> None:
        Path(TASK["report"]).write_text(json.dumps(REPORT, indent=1, default=str), encoding="utf-8")
        os._exit(1 if REPORT["errors"] else 0)

    def give_up(self) -> None:
        REPORT["errors"].append(f"not finished within {TASK['seconds']} s, at {self._steps[0].__name__}")
        self.picture("failed")
        self.finish()

    # --- helpers ------------------------------------------------------------------------------------------------

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


Path(TASK["report"]).touch()  # the session has begun
SESSION = Session()
QTimer.singleShot(int(TASK["seconds"] * 1000), SESSION.give_up)
QTimer.singleShot(1500, SESSION.advance)
