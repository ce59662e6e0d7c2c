"""Every algorithm from its own dialog: opened, filled, run to its end; its results, layers and log are looked at.

SLOPEWATCH_KEEP_IMAGES=FOLDER keeps a picture of each dialog after its run.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from processing.core.Processing import Processing
from processing.gui import AlgorithmDialog, ParametersPanel, Postprocessing
from qgis.core import QgsProject
from qgis.PyQt.QtCore import QCoreApplication, QDate, QTimer
from qgis.PyQt.QtWidgets import (
    QApplication,
    QDialogButtonBox,
    QLineEdit,
    QPushButton,
    QTextEdit,
    QToolButton,
    QWidget,
)
from slopewatch.plugin.shipped_model import TITLES as MODELS
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.algorithm_runs import RUNS
from slopewatch.tests.builders.limits import PATIENCE_S

NAMES = [*(algorithm.NAME for algorithm in ALGORITHMS), *MODELS]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    return Inputs(tmp_path_factory.mktemp("inputs"))


class Refusals:
    """Stands for the message boxes of the dialog, which would wait for a click."""

    StandardButton = AlgorithmDialog.QMessageBox.StandardButton

    def __init__(self) -> None:
        self.said: list[str] = []

    def warning(self, parent: Any, title: str, text: str) -> None:
        self.said.append(text)

    def question(self, parent: Any, title: str, text: str, *buttons: Any) -> Any:
        self.said.append(text)
        return self.StandardButton.No


@pytest.fixture
def run(provider: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, dict[str, Any]], Any]]:
    """Opens an algorithm's dialog, fills it, presses Run and waits; gives the dialog and its results."""
    refusals = Refusals()
    for part in (ParametersPanel, Postprocessing, AlgorithmDialog):
        monkeypatch.setattr(part, "iface", None)  # there is no main window
    monkeypatch.setattr(AlgorithmDialog, "QMessageBox", refusals)
    Processing.initialize()
    dialogs: list[Any] = []

    def run_dialog(name: str, values: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        dialog = AlgorithmDialog.AlgorithmDialog(provider.algorithm(name).create())
        dialogs.append(dialog)
        ended: list[tuple[bool, dict[str, Any]]] = []
        dialog.algorithmFinished.connect(lambda successful, results: ended.append((successful, results)))
        dialog.show()
        fill(dialog, values)
        taken = dialog.mainWidget().createProcessingParameters()
        assert {key: plain(taken[key]) for key in values} == {key: plain(value) for key, value in values.items()}
        dialog.runButton().click()
        end = time.monotonic() + PATIENCE_S
        while not ended and not refusals.said and time.monotonic() < end:
            QCoreApplication.processEvents()
            time.sleep(0.005)
        assert refusals.said == []
        assert ended, f"not finished within {PATIENCE_S} s"
        assert ended[0][0], log(dialog)
        return dialog, ended[0][1]

    yield run_dialog
    for dialog in dialogs:
        dialog.close()
        dialog.deleteLater()
    QgsProject.instance().clear()


def fill(dialog: Any, values: dict[str, Any]) -> None:
    """Fill the fields; lists of files through their panel, as QGIS's field takes none otherwise."""
    dialog.setParameters(values)
    for name, value in values.items():
        if isinstance(value, list):
            dialog.mainWidget().wrappers[name].wrappedWidget().findChild(QToolButton).click()
            panel = next(w for w in dialog.findChildren(QWidget) if "MultipleInput" in w.metaObject().className())
            buttons = {button.text().strip("&"): button for button in panel.findChildren(QPushButton)}
            QTimer.singleShot(200, lambda files=value: choose(files))
            buttons["Add File(s)…"].click()
            buttons["OK"].click()


def choose(files: list[str]) -> None:
    """Type files into the open dialog for files, and press Open."""
    chooser = QApplication.activeModalWidget()
    chooser.findChild(QLineEdit, "fileNameEdit").setText(" ".join(f'"{file}"' for file in files))
    chooser.findChild(QDialogButtonBox).buttons()[0].click()


def plain(value: Any) -> Any:
    """A value as it was given: the widgets of layers and destinations put theirs into objects."""
    for part in ("source", "sink"):
        value = getattr(value, part, value)
    value = value.staticValue() if hasattr(value, "staticValue") else value
    if hasattr(value, "toString") and not isinstance(value, str):
        value = (value if isinstance(value, QDate) else value.date()).toString("yyyy-MM-dd")
    if isinstance(value, (int, float)):
        return float(value)
    return [str(one) for one in value] if isinstance(value, list) else str(value)


def log(dialog: Any) -> str:
    return str(dialog.findChild(QTextEdit, "txtLog").toPlainText())


def test_every_algorithm_has_a_run(provider: Any) -> None:
    assert set(RUNS) == {algorithm.id() for algorithm in provider.algorithms()}


@pytest.mark.parametrize("name", NAMES)
def test_an_algorithm_runs_from_its_dialog(
    name: str, run: Callable[..., Any], inputs: Inputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, folder = RUNS[f"slopewatch:{name}"], tmp_path / "results"
    if name != "setupengine":
        folder.mkdir()
    case.arrange(inputs, folder, monkeypatch)
    values = case.given(inputs, folder)
    given = {key: str(value) if isinstance(value, Path) else value for key, value in values.items()}
    dialog, results = run(name, given)
    keep = os.environ.get("SLOPEWATCH_KEEP_IMAGES")
    if keep:
        dialog.resize(1000, 700)
        dialog.grab().save(str(Path(keep) / f"{name}_run.png"))
    case.right(results, inputs)
    loaded = {layer.name(): layer for layer in QgsProject.instance().mapLayers().values()}
    # names of arrows also say how many times longer they are drawn
    assert set(case.layers) <= {name.partition(" (arrows")[0] for name in loaded}, list(loaded)
    assert all(layer.isValid() for layer in loaded.values())
    declared = {output.name() for output in dialog.algorithm().outputDefinitions()}
    assert set(results) <= declared | {"CHILD_INPUTS", "CHILD_RESULTS"}
    assert "Traceback" not in log(dialog)
