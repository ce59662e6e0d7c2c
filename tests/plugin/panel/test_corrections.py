"""Corrections by hand in the panel: drawn, kept beside the results, and given to the run that is made again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsProject, QgsVectorLayer
from qgis.gui import QgsMapMouseEvent
from qgis.PyQt.QtCore import QEvent, QPoint, Qt
from qgis.PyQt.QtWidgets import QInputDialog
from slopewatch.interface.corrections import ACTIONS, FILE
from slopewatch.plugin.panel.dock import SlopeWatchPanel

CORNERS = ((100, 50), (300, 50), (300, 250), (100, 250))


@pytest.fixture
def folder(tmp_path: Path, panel: SlopeWatchPanel, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The output folder of a run, whose zones the panel lists."""
    inputs = {"epoch 2024-05-01": "/data/a.laz", "epoch 2025-05-01": "/data/b.laz", "roi": "/data/roi.gpkg"}
    rows = [{"role": role, "path": path} for role, path in inputs.items()]
    (tmp_path / "run.json").write_text(json.dumps({"command": "inspect", "inputs": rows}))
    monkeypatch.setattr(panel.corrections, "_folder", lambda: tmp_path)
    monkeypatch.setattr(QInputDialog, "getText", lambda *_: (" heap of the works ", True))
    return tmp_path


def draw(panel: SlopeWatchPanel, number: int) -> None:
    """Choose an entry of the menu, and draw a square."""
    panel.corrections.menu().actions()[number].trigger()
    tool = panel._canvas.mapTool()
    for (x, y), button in [*((c, Qt.MouseButton.LeftButton) for c in CORNERS), ((0, 0), Qt.MouseButton.RightButton)]:
        tool.canvasReleaseEvent(
            QgsMapMouseEvent(panel._canvas, QEvent.Type.MouseButtonRelease, QPoint(x, y), button, button)
        )


def test_what_is_drawn_is_kept_beside_the_results_with_its_action_and_reason(
    panel: SlopeWatchPanel, folder: Path
) -> None:
    for number in range(3):
        draw(panel, number)
        if number == 1:
            QgsProject.instance().clear()  # in another session the file goes on
    copy = shutil.copy(folder / FILE, folder / "copy.gpkg")  # without what QGIS keeps beside it
    layer = QgsVectorLayer(f"{copy}|layername=corrections", "", "ogr")
    found = [(f["action"], f["reason"], f["epoch"] or "") for f in layer.getFeatures()]
    assert found == [(action, "heap of the works", "") for action in ACTIONS]
    side = 200 * panel._canvas.mapUnitsPerPixel()
    assert [f.geometry().area() for f in layer.getFeatures()] == pytest.approx([side**2] * 3, rel=1e-6)
    assert layer.crs().authid() == "EPSG:32651"
    (shown,) = QgsProject.instance().mapLayers().values()
    looks = {one.value(): one.symbol().symbolLayer(0).strokeColor().name() for one in shown.renderer().categories()}
    assert sorted(looks) == sorted(ACTIONS)
    assert len(set(looks.values())) == len(ACTIONS), "each kind has a colour of its own"
    assert str(folder / FILE) in panel.sentence.text()


def test_nothing_is_kept_without_a_reason_that_was_confirmed(
    panel: SlopeWatchPanel, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(QInputDialog, "getText", lambda *_: ("", False))
    draw(panel, 0)
    assert not (folder / FILE).exists()


def test_run_again_opens_the_dialog_with_surveys_settings_and_corrections(
    panel: SlopeWatchPanel, folder: Path, opened: list[tuple[str, dict[str, Any]]]
) -> None:
    again = panel.corrections.menu().actions()[-1]
    again.trigger()
    draw(panel, 0)
    again.trigger()
    (name, before), (_, after) = opened
    assert name == "slopewatch:inspectslope"
    assert before == {
        "REFERENCE": "/data/a.laz",
        "REFERENCE_DATE": "2024-05-01",
        "CLOUD": "/data/b.laz",
        "CLOUD_DATE": "2025-05-01",
        "ROI": "/data/roi.gpkg",
        "SETTINGS": str(folder / "run.json"),
        "OUTPUT_FOLDER": str(folder),
        "OVERWRITE": True,
    }
    assert after == {**before, "CORRECTIONS": str(folder / FILE)}


def test_a_series_gets_the_folder_of_its_surveys_and_a_damaged_record_is_named(
    panel: SlopeWatchPanel, folder: Path, opened: list[tuple[str, dict[str, Any]]]
) -> None:
    record = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps({**record, "command": "series"}))
    panel.corrections.run_again()
    ((name, values),) = opened
    assert (name, values["INPUT"]) == ("slopewatch:inspectseries", "/data")
    (folder / "run.json").write_text("{")
    panel.corrections.run_again()
    assert len(opened) == 1
    assert panel.sentence.text().startswith(f"The run in {folder} cannot be repeated from its record")


def test_the_button_needs_a_run(panel: SlopeWatchPanel) -> None:
    assert not panel.corrections.isEnabled()
