"""Run inside QGIS by ``qgis --code``: QGIS starts without an engine, says so, and sets it up by one click.

Its task is described in qgis_session.py. Parameters: ``PICTURE_AT``, the percent at which the dialog is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtWidgets import QApplication, QProgressBar, QPushButton, QTextEdit
from qgis.utils import iface, plugins
from slopewatch.lab.sessions.qgis_session import REPORT, TASK, QgisSession


class SetupSession(QgisSession):
    ALGORITHM = "slopewatch:setupengine"

    def steps(self) -> list[Callable[[], bool | None]]:
        return [
            self.open_window,
            self.wait_for_the_message,
            self.click,
            self.look_at_progress,
            self.wait_for_result,
            self.show_log,
            self.look_at_the_second_message,
            self.finish,
        ]

    def wait_for_the_message(self) -> bool:
        self._waited += 1
        if not self.words() and self._waited < 50:
            return True
        REPORT["message"] = self.words()
        REPORT["buttons"] = [button.text() for button in self.buttons()]
        self.picture("setup_message")
        return False

    def click(self) -> None:
        self.buttons()[0].click()
        self._dialog = plugins["slopewatch"]._offer.dialog
        self._dialog.algorithmFinished.connect(self._on_finished)
        self._dialog.resize(820, 560)

    def look_at_progress(self) -> bool:
        bar = self._dialog.findChild(QProgressBar)
        if self._finished is None and bar.value() < float(TASK["parameters"]["PICTURE_AT"]):
            return True
        REPORT["percent"] = bar.value()
        REPORT["words_left"] = self.words()
        self.picture("setup_dialog", self._dialog)
        return False

    def show_log(self) -> None:
        REPORT["finished"] = self._finished
        REPORT["log"] = self._dialog.findChild(QTextEdit, "txtLog").toPlainText()
        self.picture("setup_log", self._dialog)
        self._dialog.close()

    def look_at_the_second_message(self) -> None:
        REPORT["second_message"] = self.words()
        self.picture("setup_done")

    def words(self) -> list[str]:
        """What the message bar says of SlopeWatch."""
        return [item.text() for item in self.messages()]

    def buttons(self) -> list[Any]:
        return [button for item in self.messages() for button in item.findChildren(QPushButton) if button.text()]

    def messages(self) -> list[Any]:
        return [item for item in iface.messageBar().items() if item.title() == "SlopeWatch"]

    def picture(self, name: str, widget: Any = None) -> None:
        """With the plugin's own messages, without those of QGIS over them."""
        own = self.messages()
        for item in iface.messageBar().items():
            if item not in own:
                iface.messageBar().popWidget(item)
        QCoreApplication.processEvents()
        image = QApplication.primaryScreen().grabWindow(0) if widget is None else widget.grab()
        path = str(Path(TASK["images"]) / f"{name}.png")
        if name == "setup_message":
            image = image.copy(0, 0, image.width(), 220)
        image.save(path)
        REPORT["pictures"].append(path)


SetupSession.begin()
