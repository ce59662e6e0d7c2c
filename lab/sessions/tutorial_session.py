"""Run inside QGIS by ``qgis --code``: the tutorial (docs/tutorial.md), with its pictures, in a QGIS without the plugin.

Its task is described in qgis_session.py; its parameters are ZIP, the plugin's zip, FOLDER, where the reader's files
lie, and those of ``simulatesurvey`` that the tutorial has the reader set. Dialogs are opened from the menu and the
panel, as on the page.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import qgis.utils
from qgis.core import QgsProject
from qgis.gui import QgsProcessingAlgorithmDialogBase
from qgis.PyQt.QtCore import QCoreApplication, QPoint, Qt, QTimer
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import (
    QApplication,
    QDialogButtonBox,
    QDockWidget,
    QLineEdit,
    QListWidget,
    QMessageBox,
    QPlainTextEdit,
    QPushButton,
    QTextEdit,
    QWidget,
)
from qgis.utils import iface
from qgis_session import REPORT, TASK, QgisSession

_REMARK = "Heap of a repair"


class TutorialSession(QgisSession):
    """A method for each step of the page; what takes time is waited for."""

    _panel: Any = None
    _folder: Path
    _started = _pressed = 0.0

    def steps(self) -> list[Callable[[], bool | None]]:
        return [
            self.open_window,
            self.install_from_zip,
            self.wait_for_the_message,
            self.set_up_now,
            self.wait_for_result,
            self.close_dialog,
            self.save_project,
            self.simulate,
            self.wait_for_result,
            self.close_dialog,
            self.open_panel,
            self.top_view,
            self.wait_for_result,
            self.close_dialog,
            self.show_top_view,
            self.draw_region,
            self.show_region,
            self.inspect,
            self.wait_for_result,
            self.close_dialog,
            self.show_map,
            self.show_pale_change,
            self.review,
            self.show_zone,
            self.write_report,
            self.wait_for_report,
            self.add_levels,
            self.show_levels,
            self.finish,
        ]

    # --- the page's steps ---------------------------------------------------------------------------------------

    def install_from_zip(self) -> None:
        """*Plugins → Manage and Install Plugins → Install from ZIP*; the window is filled while it waits for clicks."""
        REPORT["logs"], REPORT["computing"] = {}, {}
        QTimer.singleShot(2000, self.fill_plugin_manager)
        iface.actionManagePlugins().trigger()
        if "slopewatch" not in qgis.utils.active_plugins:
            qgis.utils.loadPlugin("slopewatch")
            qgis.utils.startPlugin("slopewatch")

    def fill_plugin_manager(self) -> None:
        manager = QApplication.activeModalWidget()
        pages = manager.findChild(QListWidget, "mOptionsListWidget")
        (page,) = (n for n in range(pages.count()) if pages.item(n).text() == "Install from ZIP")
        pages.setCurrentRow(page)
        manager.findChild(QWidget, "mZipFileWidget").findChild(QLineEdit).setText(TASK["parameters"].pop("ZIP"))
        QTimer.singleShot(500, self.agree)
        manager.findChild(QPushButton, "buttonInstallFromZip").click()
        REPORT["installed"] = "slopewatch" in qgis.utils.available_plugins
        self.picture("plugin_manager", manager)
        manager.reject()

    def agree(self) -> None:
        """Where QGIS warns of plugins from files, the reader agrees."""
        asked = QApplication.activeModalWidget()
        if isinstance(asked, QMessageBox):
            asked.button(QMessageBox.StandardButton.Yes).click()

    def wait_for_the_message(self) -> bool:
        return not [item for item in iface.messageBar().items() if item.title() == "SlopeWatch"]

    def set_up_now(self) -> None:
        (message,) = (item for item in iface.messageBar().items() if item.title() == "SlopeWatch")
        (button,) = (one for one in message.findChildren(QPushButton) if one.text() == "Set up now")
        self._pressed = time.monotonic()
        button.click()
        self.take_dialog("setupengine")

    def save_project(self) -> None:
        self._folder = Path(TASK["parameters"].pop("FOLDER"))
        self._folder.mkdir()
        QgsProject.instance().write(str(self._folder / "tutorial.qgz"))
        self._panel = iface.mainWindow().findChild(QDockWidget, "SlopeWatchPanel")
        self._panel.hide()
        self._started = time.monotonic()

    def simulate(self) -> None:
        self.choose("Tools", "Simulate a survey…")
        self.fill({**TASK["parameters"], "OUTPUT_FOLDER": str(self._folder / "survey")})
        self.picture("tutorial_1_simulate", self._dialog)
        self.run()

    def open_panel(self) -> None:
        self.choose("Panel")
        iface.mainWindow().resizeDocks([self._panel], [460], Qt.Orientation.Horizontal)

    def top_view(self) -> None:
        self._panel.areas.cloud.set_path(self.survey("2025-05-01"))
        self._panel.areas.top_view.click()
        self.take_dialog("topview")
        self.fill({"OUTPUT_FOLDER": str(self._folder / "view")})
        self.run()

    def show_top_view(self) -> bool:
        return not self.shown("Top view")

    def draw_region(self) -> None:
        """Clicks on the corners of the cut face, a little inside."""
        self._panel.areas._buttons["region"].click()
        (face,) = (feature.geometry() for feature in self.layer("Region of interest").getFeatures())
        middle, place = face.centroid().asPoint(), iface.mapCanvas().getCoordinateTransform()
        for corner in list(face.vertices())[:-1]:
            x, y = (m + 0.96 * (c - m) for m, c in ((middle.x(), corner.x()), (middle.y(), corner.y())))
            self.click(place.transform(x, y).toQPointF().toPoint())
        self.click(QPoint(20, 20), Qt.MouseButton.RightButton)
        REPORT["drawn"] = [layer.name() for layer in QgsProject.instance().mapLayers().values() if self.is_area(layer)]

    def show_region(self) -> bool:
        if not self.shown("Top view"):
            return True
        self.picture("tutorial_2_region")
        return False

    def inspect(self) -> None:
        self.choose("Inspection", "Inspect slope…")
        self.fill(
            {
                "REFERENCE": self.survey("2024-05-01"),
                "CLOUD": self.survey("2025-05-01"),
                "ROI": self.layer("Region of interest").id(),
                "OUTPUT_FOLDER": str(self._folder / "results"),
            }
        )
        self._dialog.resize(1040, 860)
        self.picture("tutorial_3_inspect", self._dialog)
        self.run()

    def show_map(self) -> bool:
        if not self._waited:
            self._panel.hide()
            for dock in iface.mainWindow().findChildren(QDockWidget):
                if dock.windowTitle().startswith("Results Viewer"):
                    dock.hide()
            for name in ("SlopeWatch simulated survey", "SlopeWatch top view of 2025-05-01"):
                group = QgsProject.instance().layerTreeRoot().findGroup(name)
                group.setExpanded(False)
                group.setItemVisibilityChecked(False)
            self.tick("Region of interest (drawn)", False)
        if not self.shown("Significant change (m)"):
            return True
        self.report_layers()
        self.picture("tutorial_4_map")
        return False

    def show_pale_change(self) -> None:
        self.tick("Significant change (m)", False)
        self.tick("Elevation change (m)", True)
        self._panel.show()

    def review(self) -> None:
        panel = self._panel
        panel.layers.setCurrentIndex(panel.layers.findText("Hazard zones"))
        rows = panel.zones.model.rows
        REPORT["zones"] = [[r.name, r.kind, r.severity, f"{r.change:+.3f}", f"{r.area:.1f}"] for r in rows]
        panel.reviews.reviewer.setText("A. Sato")
        panel.zones.choose(rows[0].feature)
        panel.reviews.confirm.click()
        panel.zones.choose(rows[-1].feature)
        panel.reviews.reject.click()
        QTimer.singleShot(500, self.type_remark)
        panel.reviews.note.click()
        panel.reviews.save.click()
        panel.zones.choose(rows[0].feature)
        QCoreApplication.processEvents()
        panel.zoom_button.click()
        self._waited = 1

    def type_remark(self) -> None:
        """In the window of *Remark…*, which waits for it."""
        window = QApplication.activeModalWidget()
        self.picture("remark", window)
        window.findChild(QPlainTextEdit).setPlainText(_REMARK)
        window.findChild(QDialogButtonBox).button(QDialogButtonBox.StandardButton.Ok).click()

    def show_zone(self) -> bool:
        if not self.drawn(""):
            return True
        self._waited = 0
        self.picture("tutorial_5_panel")
        return False

    def write_report(self) -> None:
        self._pressed = time.monotonic()
        self._panel.write_button.click()

    def wait_for_report(self) -> bool:
        if self._panel._task is not None:
            return True
        REPORT["computing"]["writereport"] = time.monotonic() - self._pressed
        report = (self._folder / "results" / "report.html").read_text(encoding="utf-8")
        REPORT["reviews_in_report"] = [words in report for words in ("A. Sato", _REMARK)]
        REPORT["panel_says"] = self._panel.sentence.text()
        return False

    def add_levels(self) -> None:
        self._panel.hide()
        for name in ("Hazard zones", "Elevation change (m)"):
            self.tick(name, False)
        for name in ("screened_smallest_hazard", "level_of_detection"):
            iface.addRasterLayer(str(self._folder / "results" / f"{name}.tif"), name)
        self.tick("screened_smallest_hazard", False)
        iface.layerTreeView().setCurrentLayer(self.layer("level_of_detection"))

    def show_levels(self) -> bool:
        if not self.shown("level_of_detection"):
            return True
        self.picture("tutorial_6_level")
        REPORT["minutes"] = (time.monotonic() - self._started) / 60
        REPORT["truth"] = json.loads((self._folder / "survey" / "truth.json").read_text(encoding="utf-8"))
        REPORT["run"] = json.loads((self._folder / "results" / "run.json").read_text(encoding="utf-8"))
        return False

    # --- helpers ------------------------------------------------------------------------------------------------

    def choose(self, *words: str) -> None:
        """An entry of *Plugins → SlopeWatch*; the dialog that it opens, if any, is the current one."""
        menu = iface.pluginMenu()
        for word in ("SlopeWatch", *words):
            entry = next(action for action in menu.actions() if action.text() == word)
            menu = entry.menu()
        entry.trigger()
        if entry.objectName():
            self.take_dialog(entry.objectName().partition(":")[2])

    def take_dialog(self, algorithm: str) -> None:
        QCoreApplication.processEvents()
        windows = [w for w in QApplication.topLevelWidgets() if isinstance(w, QgsProcessingAlgorithmDialogBase)]
        (self._dialog,) = (w for w in windows if w.isVisible() and w.algorithm().name() == algorithm)
        self._dialog.algorithmFinished.connect(self._on_finished)
        self._dialog.resize(1040, 800)

    def run(self) -> None:
        self._pressed = time.monotonic()
        super().run()

    def fill(self, values: dict[str, Any]) -> None:
        self._dialog.setParameters(values)
        QCoreApplication.processEvents()

    def close_dialog(self) -> None:
        name = self._dialog.algorithm().name()
        log = self._dialog.findChild(QTextEdit, "txtLog").toPlainText()
        REPORT["logs"][name] = log
        REPORT["computing"][name] = self._ended - self._pressed
        if not self._finished or not self._finished["successful"]:
            raise RuntimeError(f"{name} failed:\n{log}")
        self._finished = None
        self._dialog.close()

    def shown(self, name: str) -> bool:
        """Whether the layer's extent is on the map; the next call begins anew once it was."""
        done = self.drawn(name)
        if done:
            self._waited = 0
        return done

    def survey(self, day: str) -> str:
        return str(self._folder / "survey" / f"{day}.laz")

    def layer(self, name: str) -> Any:
        (found,) = QgsProject.instance().mapLayersByName(name)[-1:]
        return found

    def tick(self, name: str, visible: bool) -> None:
        node = QgsProject.instance().layerTreeRoot().findLayer(self.layer(name).id())
        node.setItemVisibilityChecked(visible)

    @staticmethod
    def is_area(layer: Any) -> bool:
        return bool(layer.customProperty("slopewatch/area"))

    def click(self, place: QPoint, button: Any = Qt.MouseButton.LeftButton) -> None:
        view = iface.mapCanvas().viewport()
        QTest.mouseMove(view, place)
        QTest.mouseClick(view, button, Qt.KeyboardModifier.NoModifier, place)
        QCoreApplication.processEvents()


TutorialSession.begin()
