"""Runs inside QGIS (``qgis --code``): pictures of every dialog of the toolbox, see ``screenshots.py``."""

from __future__ import annotations

from collections.abc import Callable

from qgis import processing
from qgis.core import QgsApplication
from qgis.PyQt.QtWidgets import QGroupBox, QScrollArea
from slopewatch.scripts.qgis_session import TASK, QgisSession

WIDTH, HEIGHT, TALLEST = 900, 760, 2300


class DialogsSession(QgisSession):
    def __init__(self) -> None:
        provider = QgsApplication.processingRegistry().providerById("slopewatch")
        wanted = TASK["parameters"].get("ALGORITHMS", "").split()
        self._waiting = sorted(a.name() for a in provider.algorithms() if not wanted or a.name() in wanted)
        super().__init__()

    def steps(self) -> list[Callable[[], bool | None]]:
        return [self.open_window, *[self.open_next, self.as_it_opens, self.all_boxes] * len(self._waiting), self.finish]

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
        self._dialog.close()


DialogsSession.begin()
