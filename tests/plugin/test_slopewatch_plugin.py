"""The plugin in QGIS: what it adds it takes away; without a GUI it has only the provider."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import slopewatch
from qgis import processing
from qgis.core import QgsApplication
from qgis.gui import QgisInterface, QgsMapCanvas, QgsMessageBar
from qgis.PyQt.QtSvg import QSvgRenderer
from qgis.PyQt.QtWidgets import QMainWindow
from slopewatch.plugin.bridge import resources, settings
from slopewatch.plugin.settings_page import SettingsPage


class Interface:
    """Counts what is added to and removed from QGIS's window."""

    def __init__(self) -> None:
        self.window = QMainWindow()
        self.canvas, self.bar = QgsMapCanvas(), QgsMessageBar()
        self.docks: list[Any] = []
        self.menu: list[tuple[str, Any]] = []
        self.toolbar: list[Any] = []
        self.pages: list[Any] = []
        self.shown: list[str] = []

    def mainWindow(self) -> QMainWindow:
        return self.window

    def mapCanvas(self) -> QgsMapCanvas:
        return self.canvas

    def messageBar(self) -> QgsMessageBar:
        return self.bar

    def addDockWidget(self, area: Any, dock: Any) -> None:
        self.docks.append(dock)

    def removeDockWidget(self, dock: Any) -> None:
        self.docks.remove(dock)

    def addPluginToMenu(self, name: str, action: Any) -> None:
        self.menu.append((name, action))

    def removePluginMenu(self, name: str, action: Any) -> None:
        self.menu.remove((name, action))

    def addToolBarIcon(self, action: Any) -> None:
        self.toolbar.append(action)

    def removeToolBarIcon(self, action: Any) -> None:
        self.toolbar.remove(action)

    def registerOptionsWidgetFactory(self, factory: Any) -> None:
        self.pages.append(factory)

    def unregisterOptionsWidgetFactory(self, factory: Any) -> None:
        self.pages.remove(factory)

    def showOptionsDialog(self, parent: Any, page: str) -> None:
        self.shown.append(page)


def test_the_double_has_qgis_names() -> None:
    names = [n for n in vars(Interface) if not n.startswith("_")]
    assert [n for n in names if not hasattr(QgisInterface, n)] == []


def test_everything_added_is_removed(qgis_app: QgsApplication) -> None:
    interface = Interface()
    plugin = slopewatch.classFactory(interface)
    plugin.initGui()
    assert QgsApplication.processingRegistry().providerById("slopewatch") is not None
    assert [action.text() for _, action in interface.menu] == [
        "Panel",
        "Inspect slope…",
        "Inspection",
        "Single steps",
        "Tools",
        "Models",
        "Set up engine…",
        "Settings…",
        "Help",
    ]
    assert [action.text() for action in interface.toolbar] == ["Inspect slope…", "Panel"]
    assert [dock.isHidden() for dock in interface.docks] == [True]
    assert len(interface.pages) == 1
    plugin.unload()
    assert QgsApplication.processingRegistry().providerById("slopewatch") is None
    assert (interface.menu, interface.toolbar, interface.pages, interface.docks) == ([], [], [], [])


def test_the_menu_has_every_tool_of_the_toolbox_and_opens_its_dialog(
    qgis_app: QgsApplication, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[tuple[str, dict[str, Any]]] = []
    monkeypatch.setattr(processing, "createAlgorithmDialog", lambda name, values: opened.append((name, values)))
    interface = Interface()
    plugin = slopewatch.classFactory(interface)
    plugin.initGui()
    try:
        groups = {a.text(): a.menu() for _, a in interface.menu if a.menu() is not None}
        algorithms = QgsApplication.processingRegistry().providerById("slopewatch").algorithms()
        offered = {entry.text(): group for group, menu in groups.items() for entry in menu.actions()}
        assert offered == {f"{a.displayName()}…": a.group() for a in algorithms}
        for menu in groups.values():
            for entry in menu.actions():
                entry.trigger()
        assert sorted(name for name, _ in opened) == sorted(a.id() for a in algorithms)
    finally:
        plugin.unload()


def test_without_a_window_only_the_provider(qgis_app: QgsApplication) -> None:
    plugin = slopewatch.classFactory(None)
    plugin.initProcessing()
    plugin.initGui()
    plugin.unload()
    assert QgsApplication.processingRegistry().providerById("slopewatch") is None


def test_the_settings_action_opens_the_page(qgis_app: QgsApplication) -> None:
    interface = Interface()
    plugin = slopewatch.classFactory(interface)
    plugin.initGui()
    try:
        next(action for _, action in interface.menu if action.text() == "Settings…").trigger()
        assert interface.shown == [interface.pages[0].createWidget(None).objectName()]
    finally:
        plugin.unload()


def test_settings_are_kept(qgis_app: QgsApplication) -> None:
    page = SettingsPage()
    page.python.setFilePath(" /opt/engine/bin/python ")
    page.apply()
    try:
        assert settings.get(settings.ENGINE_PYTHON) == "/opt/engine/bin/python"
        assert SettingsPage().python.filePath() == "/opt/engine/bin/python"
    finally:
        page.python.setFilePath("")
        page.apply()
    assert settings.get(settings.ENGINE_PYTHON) == ""


def test_check_shows_what_the_engine_says(qgis_app: QgsApplication, fake_engine: Callable[[str], Path]) -> None:
    fake_engine(
        "say(event='log', level='info', message='PDAL <2.9>')\nsay(event='result', outputs={}, metrics={'pdal': '2.9'})"
    )
    page = SettingsPage()
    page.check_button.click()
    text = page.report.toPlainText()
    assert "PDAL <2.9>" in text
    assert re.search(r"pdal:\s+2.9", text)
    assert "ready" in text
    assert page.check_button.isEnabled()


def test_check_shows_what_is_wrong_and_keeps_the_settings(
    qgis_app: QgsApplication, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SLOPEWATCH_PYTHON", raising=False)
    page = SettingsPage()
    page.python.setFilePath("/nowhere/python")
    page.check_button.click()
    assert "/nowhere/python (setting) does not exist" in page.report.toPlainText()
    assert settings.get(settings.ENGINE_PYTHON) == ""


@pytest.mark.parametrize("path", sorted(Path(resources.icon_path()).parent.glob("*")), ids=lambda p: p.name)
def test_icons_can_be_drawn(path: Path, qgis_app: QgsApplication) -> None:
    assert path.suffix == ".svg"
    assert QSvgRenderer(str(path)).isValid()
