"""Settings > Options > SlopeWatch: the engine's interpreter, PDAL and the set-up's folder, with a check of them."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsProcessingFeedback
from qgis.gui import QgsFileWidget, QgsOptionsPageWidget, QgsOptionsWidgetFactory
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QApplication, QFormLayout, QHBoxLayout, QLabel, QPushButton, QTextBrowser, QVBoxLayout

from .bridge import settings
from .bridge.engine_client import EngineError, run_engine
from .bridge.engine_setup import data_folder, find_engine
from .bridge.interpreter import InterpreterNotFoundError
from .bridge.resources import icon
from .bridge.words import tr


class SettingsPage(QgsOptionsPageWidget):
    """Three paths, all may stay empty, and a button that tests them."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self.setObjectName("slopewatchOptions")
        self.python = self._file_widget(settings.ENGINE_PYTHON, tr("The plugin's own environment"))
        self.pdal = self._file_widget(settings.PDAL, tr("The one found by the engine"))
        self.data = self._file_widget(settings.DATA_FOLDER, str(data_folder()))
        self.data.setStorageMode(QgsFileWidget.StorageMode.GetDirectory)
        self.check_button = QPushButton(tr("Check"))
        self.check_button.setToolTip(tr("Starts the engine with these settings and shows what it finds"))
        self.check_button.clicked.connect(self.check)
        self.report = QTextBrowser()
        intro = QLabel(
            tr(
                "SlopeWatch runs in its own Python environment, outside QGIS. Leave the fields empty to use what the "
                "set-up built (SlopeWatch > Set up engine…) and the PDAL that it finds; the environment variables "
                "SLOPEWATCH_PYTHON and SLOPEWATCH_DATA take precedence."
            )
        )
        intro.setWordWrap(True)
        form = QFormLayout()
        form.addRow(tr("Engine's Python interpreter"), self.python)
        form.addRow(tr("PDAL program"), self.pdal)
        form.addRow(tr("Folder of the set-up"), self.data)
        row = QHBoxLayout()
        row.addWidget(self.check_button)
        row.addStretch()
        form.addRow("", row)
        layout = QVBoxLayout(self)
        layout.addWidget(intro)
        layout.addLayout(form)
        layout.addWidget(self.report)

    def apply(self) -> None:
        """Called by QGIS on OK and Apply."""
        settings.store(settings.ENGINE_PYTHON, self.python.filePath())
        settings.store(settings.PDAL, self.pdal.filePath())
        settings.store(settings.DATA_FOLDER, self.data.filePath())

    def check(self) -> None:
        """Run the engine's own check with what the fields hold now and show its lines."""
        before = {key: settings.get(key) for key in (settings.ENGINE_PYTHON, settings.PDAL, settings.DATA_FOLDER)}
        self.apply()
        feedback = QgsProcessingFeedback(False)
        self.check_button.setEnabled(False)
        QApplication.setOverrideCursor(Qt.CursorShape.WaitCursor)
        try:
            python, how = find_engine()
            feedback.pushInfo(tr(f"Interpreter: {python} ({how})"))
            found = run_engine(["check"], feedback).metrics
            feedback.pushInfo(tr("The engine is ready."))
            for name, value in found.items():
                feedback.pushInfo(f"{name}: {value}")
        except (EngineError, InterpreterNotFoundError) as error:
            feedback.reportError(tr(str(error)))
        finally:
            QApplication.restoreOverrideCursor()
            self.check_button.setEnabled(True)
            for key, value in before.items():
                settings.store(key, value)
        self.report.setHtml(feedback.htmlLog())

    @staticmethod
    def _file_widget(key: str, placeholder: str) -> QgsFileWidget:
        widget = QgsFileWidget()
        widget.setFilePath(settings.get(key))
        widget.lineEdit().setPlaceholderText(placeholder)
        return widget


class SettingsPageFactory(QgsOptionsWidgetFactory):
    """Makes the page for QGIS's options dialog."""

    def __init__(self) -> None:
        super().__init__("SlopeWatch", QIcon())
        self.setTitle("SlopeWatch")

    def icon(self) -> QIcon:
        return icon()

    def createWidget(self, parent: Any) -> SettingsPage:
        return SettingsPage(parent)
