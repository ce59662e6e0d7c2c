"""Set up engine: build the engine's environment in the user's data folder, repair it, add the screening's network."""

from __future__ import annotations

from typing import Any

from qgis.core import (
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingOutputBoolean,
    QgsProcessingOutputString,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterFile,
)

from ..plugin.bridge import compat
from ..plugin.bridge.engine_setup import data_folder, find_engine, order
from ..plugin.bridge.setup import places, state
from ..plugin.bridge.setup.building import set_up
from ..plugin.bridge.setup.problems import SetupError
from ..plugin.bridge.setup.workshop import Order, Reporter
from ..plugin.bridge.words import tr
from . import declare
from .base import SlopeWatchAlgorithm
from .values import Values

WHEELS = "Takes all packages from this folder instead of the network; each is checked by its hash all the same."


class SetupEngine(SlopeWatchAlgorithm):
    NAME = "setupengine"
    TITLE = "Set up engine"
    GROUP = "tools"
    SUMMARY = "Downloads and builds the engine that SlopeWatch computes with; repairs it, or adds PyTorch."
    TAGS = ("install", "installation", "environment", "repair", "update", "pytorch", "engine", "setup")

    def inputs(self) -> None:
        screening = QgsProcessingParameterBoolean("SCREENING", "Add PyTorch", False)
        repair = QgsProcessingParameterBoolean("REPAIR", "Repair: build anew what stands", False)
        wheels = QgsProcessingParameterFile("WHEELS", "Folder of wheels", compat.FOLDER, optional=True)
        python = QgsProcessingParameterFile("PYTHON", "Python to build from", optional=True, fileFilter="All files (*)")
        self.add(
            declare.with_help(
                screening, "Also downloads what RandLA-Net (the screening method network) and training need."
            ),
            declare.with_help(repair, "The engine in use is replaced only when the new one has been checked."),
            declare.with_help(wheels, WHEELS, advanced=True),
            declare.with_help(python, "3.10 or newer; left empty, QGIS's own is taken, else one found.", advanced=True),
        )
        self.addOutput(QgsProcessingOutputString("ENGINE", "Engine's interpreter"))
        self.addOutput(QgsProcessingOutputString("PYTHON_VERSION", "Its Python"))
        self.addOutput(QgsProcessingOutputString("FOLDER", "Folder of the set-up"))
        self.addOutput(QgsProcessingOutputBoolean("SCREENING_READY", "PyTorch is there"))

    def arguments(self, values: Values) -> list[str]:
        return []  # it runs no command of the engine

    def prepareAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> bool:
        # In QGIS's main thread, where the settings are read.
        self._order = order(
            self.parameterAsBool(parameters, "SCREENING", context),
            self.parameterAsBool(parameters, "REPAIR", context),
            self.parameterAsFile(parameters, "WHEELS", context),
            self.parameterAsFile(parameters, "PYTHON", context),
        )
        self._folder = data_folder()
        return True

    def processAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        feedback.pushInfo(tr(f"The engine is built in {self._folder}; the log is {self._folder / places.LOG}."))
        made = _built(self._order, feedback)
        interpreter = state.interpreter(self._folder, made)
        used, how = find_engine()
        if used != interpreter:
            words = f"The engine that was built is not in use, as another one is named: {used} ({how})."
            feedback.pushWarning(tr(words))
        return {
            "ENGINE": str(interpreter),
            "PYTHON_VERSION": made.python,
            "FOLDER": str(self._folder),
            "SCREENING_READY": bool(made.screening),
        }


def _built(what: Order, feedback: QgsProcessingFeedback) -> state.State:
    """Build it, with QGIS's progress and log."""
    shown = ""

    def progress(percent: float, words: str) -> None:
        nonlocal shown
        feedback.setProgress(percent)
        step = "Installing packages" if words.startswith("Installing packages") else words.partition(": ")[0]
        if step != shown:
            shown = step
            feedback.setProgressText(tr(step))

    def info(words: str) -> None:
        feedback.pushInfo(tr(words))

    def warn(words: str) -> None:
        feedback.pushWarning(tr(words))

    try:
        return set_up(what, Reporter(progress, info, warn, feedback.isCanceled))
    except SetupError as error:
        raise QgsProcessingException(tr(str(error))) from None
