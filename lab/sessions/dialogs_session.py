"""Runs inside QGIS (``qgis --code``): pictures of every dialog of the toolbox, see ``screenshots.py``.

Its task is described in qgis_session.py. Parameters: ``ALGORITHMS``, names of those that are wanted instead of all, and
``VALUES``, a JSON file of values by the names of algorithms; these are filled in, run, and their layers are shown.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

from qgis import processing
from qgis.core import QgsApplication
from qgis.PyQt.QtWidgets import QDockWidget, QGroupBox, QScrollArea, QTextEdit
from qgis.utils import iface
from slopewatch.lab.sessions.qgis_session import REPORT, TASK, QgisSession

WIDTH, HEIGHT, TALLEST = 900, 760, 2300


class DialogsSession(QgisSession):
    def __init__(self) -> None:
        provider = QgsApplication.processingRegistry().providerById("slopewatch")
        wanted = TASK["parameters"].get("ALGORITHMS", "").split()
        values = TASK["parameters"].get("VALUES", "")
        self._values = json.loads(Path(values).read_text(encoding="utf-8")) if values else {}
        self._pressed = 0.0
        REPORT["logs"], REPORT["computing"] = {}, {}
        self._waiting = sorted(a.name() for a in provider.algorithms() if not wanted or a.name() in wanted)
        super().__init__()

    def steps(self) -> list[Callable[[], bool | None]]:
        each = [self.open_next, self.as_it_opens, self.all_boxes, self.fill_and_run, self.wait, self.show_map]
        return [self.open_window, *each * len(self._waiting), self.finish]

    def open_next(self) -> None:
        self.name = self._waiting.pop(0)
        self._dialog = processing.createAlgorithmDialog(f"slopewatch:{self.name}")
        for box in self._dialog.findChildren(QGroupBox):
            box.setProperty("saveCollapsedState", False)  # what is opened here must not be open in the next dialog
        self._dialog.show()
        self._dialog.resize(WIDTH, HEIGHT)

    def as_it_opens(self) -> None:
        self.picture(self.name, self._dialog)
        for box in self._dialog.findChildren(QGroupBox):
            box.setProperty("collapsed", False)
        areas = self._dialog.findChildren(QScrollArea)
        needed = max((a.widget().sizeHint().height() for a in areas if a.widget() is not None), default=HEIGHT)
        self._dialog.resize(WIDTH, min(TALLEST, needed + 220))

    def all_boxes(self) -> None:
        self.picture(f"{self.name}_all", self._dialog)
        if self.name not in self._values:
            self._dialog.close()

    def fill_and_run(self) -> None:
        if self.name in self._values:
            iface.newProject()
            self._finished = None
            self._dialog.algorithmFinished.connect(self._on_finished)
            self._dialog.setParameters(self._values[self.name])
            for box in self._dialog.findChildren(QGroupBox):
                box.setProperty("collapsed", True)
            for area in self._dialog.findChildren(QScrollArea):
                area.verticalScrollBar().setValue(0)
            self._dialog.resize(WIDTH, HEIGHT)
            self.picture(f"{self.name}_filled", self._dialog)
            self._pressed = time.monotonic()
            self.run()

    def wait(self) -> bool:
        if self.name not in self._values:
            return False
        if self._finished is None:
            return True
        REPORT["computing"][self.name] = self._ended - self._pressed
        REPORT["logs"][self.name] = self._dialog.findChild(QTextEdit, "txtLog").toPlainText()
        self.picture(f"{self.name}_log", self._dialog)
        self._dialog.close()
        for dock in iface.mainWindow().findChildren(QDockWidget):
            dock.setVisible(dock.objectName() == "Layers")
        self._waited = 0
        return False

    def show_map(self) -> bool:
        """The map as the run leaves it, on the extent of all layers."""
        if self.name not in self._values:
            return False
        if not self._waited:
            iface.mapCanvas().zoomToFullExtent()
        if not self.drawn(""):
            return True
        self.picture(f"{self.name}_map")
        return False


DialogsSession.begin()
