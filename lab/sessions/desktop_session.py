"""Run inside QGIS by ``qgis --code``: use the plugin as an analyst does, take pictures, write a report, leave.

Its task is described in qgis_session.py; its parameters are those of inspectslope.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis import processing
from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication, Qt, QTimer
from qgis.PyQt.QtWidgets import QApplication, QDockWidget, QTextEdit, QTreeView
from qgis.utils import iface, plugins
from slopewatch.lab.sessions.qgis_session import REPORT, TASK, QgisSession


class DesktopSession(QgisSession):
    ALGORITHM = "slopewatch:inspectslope"
    _pressed = 0.0

    def steps(self) -> list[Callable[[], bool | None]]:
        return [
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
            self._dialog = processing.createAlgorithmDialog(self.ALGORITHM, parameters)
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

        algorithm = QgsApplication.processingRegistry().createAlgorithmById(self.ALGORITHM)
        dialog = BatchAlgorithmDialog(algorithm, parent=iface.mainWindow())
        dialog.resize(1300, 420)
        dialog.show()
        self.picture("batch", dialog)
        dialog.close()

    def show_map(self) -> bool:
        if not self._waited:
            iface.mainWindow().findChild(QDockWidget, "ProcessingToolbox").show()
        if not self.drawn("Elevation change (m)"):
            return True
        self.report_layers()
        self.picture("desktop")
        self.picture("map", iface.mapCanvas())
        return False

    def show_zone(self) -> None:
        self.table_of("Hazard zones", "zones")

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


DesktopSession.begin()
