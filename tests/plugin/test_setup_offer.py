"""The message that offers the set-up: only where there is something to set up, and away when the plugin goes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import slopewatch
from qgis import processing
from qgis.core import QgsApplication
from qgis.gui import QgsMessageBar
from qgis.PyQt.QtCore import pyqtSignal
from qgis.PyQt.QtWidgets import QPushButton, QWidget
from slopewatch.plugin import setup_offer
from slopewatch.plugin.bridge import engine_setup
from slopewatch.plugin.bridge.setup import state
from slopewatch.plugin.bridge.setup.requirements import ENGINE_LOCK
from slopewatch.plugin.setup_offer import SetupOffer


class Window:
    """The part of QGIS's interface that the offer uses, with a real message bar."""

    def __init__(self) -> None:
        self.widget = QWidget()
        self.bar = QgsMessageBar(self.widget)

    def messageBar(self) -> QgsMessageBar:
        return self.bar

    def words(self) -> list[str]:
        return [item.text() for item in self.bar.items()]

    def buttons(self) -> list[Any]:
        return [b for item in self.bar.items() for b in item.findChildren(QPushButton) if b.text()]


@pytest.fixture
def data(qgis_app: QgsApplication, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder in which nothing has been built, for a plugin without an environment of its own."""
    monkeypatch.delenv("SLOPEWATCH_PYTHON", raising=False)
    monkeypatch.setenv("SLOPEWATCH_DATA", str(tmp_path))
    monkeypatch.setattr(engine_setup, "own_environments", lambda folder: [])
    return tmp_path


def build(data: Path, version: str, lock: str) -> None:
    python = data / "environment-abc123" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("")
    (data / "environment-abc123" / "pyvenv.cfg").write_text(f"home = {data}\n")
    state.write(data, state.State("environment-abc123", lock, version, "3.12.1", "python3"))


def test_a_missing_engine_is_offered_with_one_button(data: Path) -> None:
    window = Window()
    SetupOffer(window).show_if_needed()
    assert [words.startswith("The SlopeWatch engine is missing.") for words in window.words()] == [True]
    assert [button.text() for button in window.buttons()] == ["Set up now"]


def test_one_that_stands_is_not(data: Path) -> None:
    build(data, "0.2.0", state.digest(ENGINE_LOCK))
    window = Window()
    SetupOffer(window).show_if_needed()
    assert window.words() == []


def test_one_that_is_older_than_the_plugin_is_offered(data: Path) -> None:
    build(data, "0.1.0", "of another lock")
    window = Window()
    SetupOffer(window).show_if_needed()
    assert window.words() == [setup_offer.WORDS[state.Condition.OUTDATED]]


def test_one_whose_python_is_gone_is_offered(data: Path) -> None:
    build(data, "0.2.0", state.digest(ENGINE_LOCK))
    (data / "environment-abc123" / "pyvenv.cfg").write_text(f"home = {data / 'removed'}\n")
    window = Window()
    SetupOffer(window).show_if_needed()
    assert window.words() == [setup_offer.WORDS[state.Condition.BROKEN]]


def test_a_named_interpreter_is_not_replaced(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLOPEWATCH_PYTHON", "/opt/engine/bin/python")
    window = Window()
    SetupOffer(window).show_if_needed()
    assert window.words() == []


class Dialog(QWidget):
    """Stands for Processing's dialog, which needs QGIS's whole window; tests/qgis clicks the real one."""

    algorithmFinished = pyqtSignal(bool, dict)  # noqa: N815

    def __init__(self) -> None:
        super().__init__()
        self.run = QPushButton("Run")
        self.clicks: list[bool] = []
        self.run.clicked.connect(self.clicks.append)

    def runButton(self) -> QPushButton:
        return self.run


def test_the_button_opens_the_dialog_and_starts_it(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[tuple[str, dict[str, Any]]] = []
    dialog = Dialog()

    def create(algorithm: str, parameters: dict[str, Any]) -> Dialog:
        opened.append((algorithm, parameters))
        return dialog

    monkeypatch.setattr(processing, "createAlgorithmDialog", create)
    window = Window()
    offer = SetupOffer(window)
    offer.show_if_needed()
    window.buttons()[0].click()
    assert opened == [("slopewatch:setupengine", {})]
    assert len(dialog.clicks) == 1
    assert window.words() == [], "the message is withdrawn"
    dialog.algorithmFinished.emit(True, {"SCREENING_READY": False})
    window.buttons()[0].click()
    assert opened[1:] == [("slopewatch:setupengine", {"SCREENING": True})]


def test_from_the_menu_the_dialog_waits_for_the_user(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dialog = Dialog()
    monkeypatch.setattr(processing, "createAlgorithmDialog", lambda algorithm, parameters: dialog)
    SetupOffer(Window()).open()
    assert dialog.isVisible()
    assert dialog.clicks == []


def test_after_the_engine_the_network_is_offered(data: Path) -> None:
    window = Window()
    offer = SetupOffer(window)
    offer._finished(True, {"SCREENING_READY": False})
    assert [button.text() for button in window.buttons()] == ["Add PyTorch"]
    offer._finished(True, {"SCREENING_READY": True})
    assert [button.text() for button in window.buttons()] == []
    assert "with PyTorch" in window.words()[-1]


def test_a_failure_says_nothing_more_than_its_dialog(data: Path) -> None:
    window = Window()
    SetupOffer(window)._finished(False, {})
    assert window.words() == []


def test_a_plugin_that_goes_takes_its_message_along(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from slopewatch.tests.plugin.test_slopewatch_plugin import Interface

    window, interface = Window(), Interface()
    monkeypatch.setattr(interface, "messageBar", window.messageBar, raising=False)
    plugin = slopewatch.classFactory(interface)
    plugin.initGui()
    plugin._offer_setup()
    assert len(window.words()) == 1
    plugin.unload()
    assert window.words() == []
    plugin._offer_setup()
    assert window.words() == []
