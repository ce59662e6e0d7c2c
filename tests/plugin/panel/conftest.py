"""Runs of the real engine on small simulated surveys, and a panel in a window without a display."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsCoordinateReferenceSystem, QgsProject, QgsRectangle
from qgis.gui import QgsMapCanvas, QgsMessageBar
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtWidgets import QMainWindow
from slopewatch.plugin.bridge.engine_client import run_engine
from slopewatch.plugin.panel.dock import SlopeWatchPanel
from slopewatch.tests.builders.qgis import Recorder, engine_python

DAYS = ("2024-05-01", "2025-05-01")


@pytest.fixture(scope="session")
def pair_run(qgis_app: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of inspect, on a slope on which four places moved."""
    engine_python()
    folder = tmp_path_factory.mktemp("pair")
    size = ["--points", "60000", "--length", "24", "--height", "10", "--vegetation", "0.2"]
    run_engine(["simulate", "survey", *size, "--output-dir", str(folder / "survey")], Recorder())
    epochs = [part for day in DAYS for part in ("--epoch", f"{day}={folder / 'survey' / day}.laz")]
    options = ["--roi", str(folder / "survey" / "roi.gpkg"), "--no-screen-last-epoch", "--zone-profiles", "2"]
    run_engine(["inspect", *epochs, *options, "--output-dir", str(folder / "results")], Recorder())
    return folder / "results"


@pytest.fixture(scope="session")
def series_run(qgis_app: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of series, on a slope on which three zones creep."""
    engine_python()
    folder = tmp_path_factory.mktemp("series")
    size = ["--points", "20000", "--length", "16", "--height", "6"]
    run_engine(["simulate", "series", *size, "--output-dir", str(folder / "surveys")], Recorder())
    surveys, roi = folder / "surveys" / "surveys.csv", folder / "surveys" / "roi.gpkg"
    run_engine(["series", str(surveys), "--roi", str(roi), "--output-dir", str(folder / "results")], Recorder())
    return folder / "results"


@pytest.fixture
def results(pair_run: Path, tmp_path: Path) -> Path:
    """A copy of the run of two surveys, to write into."""
    return shutil.copytree(pair_run, tmp_path / "results")


class Interface:
    """What the panel takes of QGIS's window."""

    def __init__(self) -> None:
        self.window, self.canvas, self.bar = QMainWindow(), QgsMapCanvas(), QgsMessageBar()
        self.window.setCentralWidget(self.canvas)
        self.canvas.resize(QSize(400, 300))
        self.canvas.setDestinationCrs(QgsCoordinateReferenceSystem("EPSG:32651"))
        self.canvas.setExtent(QgsRectangle(500500, 3500200, 500600, 3500275))

    def mainWindow(self) -> QMainWindow:
        return self.window

    def mapCanvas(self) -> QgsMapCanvas:
        return self.canvas

    def messageBar(self) -> QgsMessageBar:
        return self.bar


@pytest.fixture
def opened() -> list[tuple[str, dict[str, Any]]]:
    """The dialogs that the panel asked for."""
    return []


@pytest.fixture
def panel(qgis_app: Any, opened: list[tuple[str, dict[str, Any]]]) -> Iterator[SlopeWatchPanel]:
    interface = Interface()
    made = SlopeWatchPanel(interface, lambda name, values: opened.append((name, values)))
    made.reviews.reviewer.setText("A. Sato")
    yield made
    QgsProject.instance().clear()
    made.close_down()
    interface.window.close()


@pytest.fixture
def warnings(panel: SlopeWatchPanel, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The warnings that the panel shows."""
    said: list[str] = []

    def say(sentence: str, warning: bool) -> None:
        if warning:
            said.append(sentence)

    for part in (panel.areas, panel.reviews):
        monkeypatch.setattr(part, "_say", say)
    monkeypatch.setattr(panel, "say", say)
    return said


@pytest.fixture
def settled(qgis_app: Any) -> Callable[[], None]:
    """Lets the panel read again what has changed."""

    def settle() -> None:
        for _ in range(3):
            qgis_app.processEvents()

    return settle
