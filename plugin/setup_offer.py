"""Offers the set-up where the engine is missing: a message at QGIS's start, and its dialog by one click."""

from __future__ import annotations

import contextlib
from typing import Any

from qgis.core import Qgis
from qgis.PyQt.QtWidgets import QPushButton

from .bridge.engine_setup import condition
from .bridge.setup.state import Condition
from .bridge.words import tr

ALGORITHM = "slopewatch:setupengine"
TITLE = "SlopeWatch"
WORDS = {
    Condition.MISSING: "The SlopeWatch engine is missing. It is downloaded once: 240 MB, some minutes, 1 GB on disk.",
    Condition.OUTDATED: "The SlopeWatch engine is older than the plugin.",
    Condition.BROKEN: "The SlopeWatch engine is not whole any more: its Python was moved or removed.",
}


class SetupOffer:
    """The messages about the engine in QGIS's window, and the dialog that they open."""

    def __init__(self, iface: Any) -> None:
        self._iface = iface
        self._message: Any = None
        self.dialog: Any = None

    def show_if_needed(self) -> None:
        """Put the message up where there is something to set up."""
        found = condition()
        if found in WORDS:
            self._show(WORDS[found], "Set up now", Qgis.MessageLevel.Warning, {})

    def open(self, parameters: dict[str, Any] | None = None, *, start: bool = False) -> Any:
        """The dialog of the set-up: its progress, its log, cancelling. With ``start`` it begins at once."""
        from qgis import processing

        self.withdraw()
        self.dialog = processing.createAlgorithmDialog(ALGORITHM, parameters or {})
        if self.dialog is not None:
            self.dialog.algorithmFinished.connect(self._finished)
            self.dialog.show()
            if start:
                self.dialog.runButton().click()
        return self.dialog

    def withdraw(self) -> None:
        """Take the message away, where it is still there."""
        message, self._message = self._message, None
        if message is not None:
            with contextlib.suppress(RuntimeError):  # the user closed it, and Qt has deleted it
                self._iface.messageBar().popWidget(message)

    def _show(self, words: str, button: str, level: Any, parameters: dict[str, Any]) -> None:
        bar = self._iface.messageBar()
        self._message = bar.createMessage(TITLE, tr(words))
        push = QPushButton(tr(button))
        push.clicked.connect(lambda *_: self.open(parameters, start=True))
        self._message.layout().addWidget(push)
        bar.pushWidget(self._message, level, 0)

    def _finished(self, successful: bool, results: dict[str, Any]) -> None:
        if not successful:
            return  # the dialog shows why
        self.withdraw()
        if results.get("SCREENING_READY"):
            self._iface.messageBar().pushSuccess(TITLE, tr("The engine is ready, with PyTorch."))
            return
        words = "The engine is ready. RandLA-Net and training need PyTorch as well: another 200 MB, 1 GB on disk."
        self._show(words, "Add PyTorch", Qgis.MessageLevel.Success, {"SCREENING": True})
