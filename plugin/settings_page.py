"""Settings > Options > SlopeWatch: the engine's interpreter and PDAL, with a check of both."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsProcessingFeedback
from qgis.gui import QgsFileWidget, QgsOptionsPageWidget, QgsOptionsWidgetFactory
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QApplication, QFormLayout, QHBoxLayout, QLabel, QPushButton, QTextBrowser, QVBoxLayout

from .bridge import settings
from .bridge.engine_client import EngineError, run_engine
from .bridge.interpreter import InterpreterNotFoundError, find_interpreter
from .bridge.resources import icon


class SettingsPage(QgsOptionsPageWidget):
    """Two paths, both may stay empty, and a button that tests them."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self.setObjectName("slopewatchOptions")
        self.python = self._file_widget(settings.ENGINE_PYTHON, "The plugin's own environment")
        self.pdal = self._file_widget(settings.PDAL, "The one found by the engine")
        self.check_button = QPushButton("Check")
        self.check_button.setToolTip("Starts the engine with these settings and shows what it finds")
        self.check_button.clicked.connect(self.check)
        self.report = QTextBrowser()
        intro = QLabel(
            "SlopeWatch runs in its own Python environment, outside QGIS. Leave both fields empty to use what the "
            "set-up installed; the environment variables SLOPEWATCH_PYTHON and SLOPEWATCH_PDAL take precedence."
        )
        intro.setWordWrap(True)
        form = QFormLayout()
        form.addRow("Engine's Python interpreter", self.python)
        form.addRow("PDAL program", self.pdal)
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

    def check(self) -> None:
        """Run the engine's own check with what the fields hold now and show its lines."""
        before = settings.get(settings.ENGINE_PYTHON), settings.get(settings.PDAL)
        self.apply()
        feedback = QgsProcessingFeedback(False)
        self.check_button.setEnabled(False)
        QApplication.setOverrideCursor(Qt.CursorShape.WaitCursor)
        try:
            python, how = find_interpreter(settings.get(settings.ENGINE_PYTHON))
            feedback.pushInfo(f"Interpreter: {python} ({how})")
            found = run_engine(["check"], feedback).metrics
            feedback.pushInfo("The engine is ready.")
            for name, value in found.items():
                feedback.pushInfo(f"{name}: {value}")
        except (EngineError, InterpreterNotFoundError) as error:
            feedback.reportError(str(error))
        finally:
            QApplication.restoreOverrideCursor()
            self.check_button.setEnabled(True)
            settings.store(settings.ENGINE_PYTHON, before[0])
            settings.store(settings.PDAL, before[1])
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
