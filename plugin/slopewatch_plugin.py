"""The plugin as QGIS sees it: the Processing provider, a menu and toolbar entry, the settings page and the help."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QUrl
from qgis.PyQt.QtGui import QDesktopServices

from .bridge.resources import help_url, icon
from .provider import SlopeWatchProvider

MENU = "SlopeWatch"


class SlopeWatchPlugin:
    """Made by ``classFactory``; ``iface`` is None under qgis_process, which calls ``initProcessing`` only."""

    def __init__(self, iface: Any) -> None:
        self._iface = iface
        self._provider: SlopeWatchProvider | None = None
        self._actions: list[Any] = []
        self._toolbar_action: Any = None
        self._settings_page: Any = None

    def initProcessing(self) -> None:
        if self._provider is None:
            self._provider = SlopeWatchProvider()
            QgsApplication.processingRegistry().addProvider(self._provider)

    def initGui(self) -> None:
        self.initProcessing()
        if self._iface is None:
            return
        from .settings_page import SettingsPageFactory

        self._settings_page = SettingsPageFactory()
        self._iface.registerOptionsWidgetFactory(self._settings_page)
        inspect = self._add_action("Inspect slope…", icon("inspectslope"), self.open_inspection)
        inspect.setToolTip("SlopeWatch: inspect a slope from two surveys")
        self._iface.addToolBarIcon(inspect)
        self._toolbar_action = inspect
        self._add_action("Simulate a survey…", icon("simulatesurvey"), lambda: self._open("slopewatch:simulatesurvey"))
        self._add_action("Settings…", QgsApplication.getThemeIcon("/mActionOptions.svg"), self.open_settings)
        self._add_action("Help", QgsApplication.getThemeIcon("/mActionHelpContents.svg"), self.open_help)

    def unload(self) -> None:
        """Take everything back that ``initGui`` and ``initProcessing`` added."""
        if self._toolbar_action is not None:
            self._iface.removeToolBarIcon(self._toolbar_action)
            self._toolbar_action = None
        for action in self._actions:
            self._iface.removePluginMenu(MENU, action)
            action.deleteLater()
        self._actions.clear()
        if self._settings_page is not None:
            self._iface.unregisterOptionsWidgetFactory(self._settings_page)
            self._settings_page = None
        if self._provider is not None:
            QgsApplication.processingRegistry().removeProvider(self._provider)
            self._provider = None

    def open_inspection(self) -> None:
        self._open("slopewatch:inspectslope")

    def open_settings(self) -> None:
        self._iface.showOptionsDialog(self._iface.mainWindow(), "slopewatchOptions")

    def open_help(self) -> None:
        QDesktopServices.openUrl(QUrl(help_url("index")))

    def _add_action(self, text: str, image: Any, slot: Any) -> Any:
        try:  # QAction moved between Qt 5 and Qt 6
            from qgis.PyQt.QtGui import QAction
        except ImportError:
            from qgis.PyQt.QtWidgets import QAction

        action = QAction(image, text, self._iface.mainWindow())
        action.triggered.connect(lambda *_: slot())
        self._iface.addPluginToMenu(MENU, action)
        self._actions.append(action)
        return action

    def _open(self, algorithm: str) -> None:
        from qgis import processing

        dialog = processing.createAlgorithmDialog(algorithm)
        if dialog is not None:
            dialog.show()
