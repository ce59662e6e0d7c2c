"""The plugin as QGIS sees it: the Processing provider, the menu and toolbar, the panel, the settings page, the help."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qgis.core import QgsApplication, QgsProject
from qgis.PyQt.QtCore import Qt, QTimer, QUrl
from qgis.PyQt.QtGui import QDesktopServices, QIcon

from .bridge import language
from .bridge.resources import help_url, icon
from .bridge.words import tr
from .provider import SlopeWatchProvider
from .setup_offer import SetupOffer

MENU = "SlopeWatch"
OFFER_AFTER_MS = 1500
"""After QGIS's own messages at its start, so that this one is not below them."""


class SlopeWatchPlugin:
    """Made by ``classFactory``; ``iface`` is None under qgis_process, which calls ``initProcessing`` only."""

    def __init__(self, iface: Any) -> None:
        self._iface = iface
        self._provider: SlopeWatchProvider | None = None
        self._actions: list[Any] = []
        self._toolbar: list[Any] = []
        self._menus: list[Any] = []
        self._settings_page: Any = None
        self._offer: SetupOffer | None = None
        self._panel: Any = None
        self._translator: Any = language.install()

    def initProcessing(self) -> None:
        if self._provider is None:
            self._provider = SlopeWatchProvider()
            QgsApplication.processingRegistry().addProvider(self._provider)
            self._provider.refreshAlgorithms()  # with the models, whose steps are known only now

    def initGui(self) -> None:
        self.initProcessing()
        if self._iface is None:
            return
        from .panel.dock import SlopeWatchPanel
        from .settings_page import SettingsPageFactory

        self._settings_page = SettingsPageFactory()
        self._iface.registerOptionsWidgetFactory(self._settings_page)
        self._panel = SlopeWatchPanel(self._iface, self.open_dialog)
        self._iface.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, self._panel)
        self._panel.hide()
        shown = self._panel.toggleViewAction()
        shown.setText(tr("Panel"))
        shown.setIcon(icon("panel"))
        shown.setToolTip(tr("SlopeWatch: areas, zones and their reviews"))
        self._iface.addPluginToMenu(MENU, shown)
        self._actions.append(shown)
        inspect = self._add_action(tr("Inspect slope…"), icon("inspectslope"), self.open_inspection)
        inspect.setToolTip(tr("SlopeWatch: inspect a slope from two surveys"))
        self._add_tools()
        self._offer = SetupOffer(self._iface)
        self._add_action(tr("Set up engine…"), icon("setupengine"), self.open_setup)
        self._add_action(tr("Settings…"), QgsApplication.getThemeIcon("/mActionOptions.svg"), self.open_settings)
        self._add_action(tr("Help"), QgsApplication.getThemeIcon("/mActionHelpContents.svg"), self.open_help)
        self._toolbar = [inspect, shown]
        for action in self._toolbar:
            self._iface.addToolBarIcon(action)
        QTimer.singleShot(OFFER_AFTER_MS, self._offer_setup)

    def unload(self) -> None:
        """Take everything back that ``initGui`` and ``initProcessing`` added."""
        if self._offer is not None:
            self._offer.withdraw()
            self._offer = None
        for action in self._toolbar:
            self._iface.removeToolBarIcon(action)
        for action in self._actions:
            self._iface.removePluginMenu(MENU, action)
            action.deleteLater()
        for menu in self._menus:
            menu.deleteLater()
        for kept in (self._toolbar, self._actions, self._menus):
            kept.clear()
        if self._panel is not None:
            self._panel.close_down()
            self._iface.removeDockWidget(self._panel)
            self._panel.deleteLater()
            self._panel = None
        if self._settings_page is not None:
            self._iface.unregisterOptionsWidgetFactory(self._settings_page)
            self._settings_page = None
        if self._provider is not None:
            QgsApplication.processingRegistry().removeProvider(self._provider)
            self._provider = None
        if self._translator is not None:
            language.remove(self._translator)
            self._translator = None

    def open_inspection(self) -> None:
        self.open_dialog("slopewatch:inspectslope")

    def open_setup(self) -> None:
        if self._offer is not None:
            self._offer.open()

    def _offer_setup(self) -> None:
        if self._offer is not None:  # the plugin may be gone by now
            self._offer.show_if_needed()

    def open_settings(self) -> None:
        self._iface.showOptionsDialog(self._iface.mainWindow(), "slopewatchOptions")

    def open_help(self) -> None:
        QDesktopServices.openUrl(QUrl(help_url("index")))

    def open_dialog(self, algorithm: str, values: dict[str, Any] | None = None) -> None:
        """Open an algorithm's dialog with ``values``, and with the areas that were drawn last where it takes them."""
        from qgis import processing

        dialog = processing.createAlgorithmDialog(algorithm, dialog_values(algorithm, values or {}))
        if dialog is not None:
            dialog.show()

    def _add_tools(self) -> None:
        """All tools of the toolbox, by their groups."""
        from .menu import tool_menus

        self._menus = tool_menus(self._provider, self.open_dialog, self._iface.mainWindow())
        for menu in self._menus:
            self._iface.addPluginToMenu(MENU, menu.menuAction())
            self._actions.append(menu.menuAction())

    def _add_action(self, text: str, image: QIcon, slot: Callable[[], Any]) -> Any:
        from .menu import action

        made = action(text, image, slot, self._iface.mainWindow())
        self._iface.addPluginToMenu(MENU, made)
        self._actions.append(made)
        return made


def dialog_values(algorithm: str, values: dict[str, Any]) -> dict[str, Any]:
    """``values``, and those of the drawn areas that the algorithm has parameters for."""
    from .panel.areas import drawn_areas

    known = QgsApplication.processingRegistry().algorithmById(algorithm)
    areas = drawn_areas(QgsProject.instance()) if known is not None else {}
    return {**{name: area for name, area in areas.items() if known.parameterDefinition(name) is not None}, **values}
