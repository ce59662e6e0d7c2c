"""Check the environment: is the engine there, and what does it run on?"""

from __future__ import annotations

from typing import Any

from qgis.core import (
    QgsProcessingException,
    QgsProcessingOutputString,
)

from ..plugin.bridge import resources
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.engine_setup import find_engine
from ..plugin.bridge.interpreter import InterpreterNotFoundError
from ..plugin.bridge.words import tr
from .base import SlopeWatchAlgorithm
from .values import Values


class CheckEnvironment(SlopeWatchAlgorithm):
    NAME = "checkenvironment"
    TITLE = "Check environment"
    GROUP = "tools"
    SUMMARY = "Finds the engine and PDAL, and says what is missing and how to get it."
    TAGS = (
        "environment", "pdal", "installation", "install", "set-up", "diagnosis", "version", "troubleshooting",
    )  # fmt: skip

    def inputs(self) -> None:
        self.addOutput(QgsProcessingOutputString("ENGINE", "Engine's interpreter"))
        self.addOutput(QgsProcessingOutputString("PDAL", "PDAL"))
        self.addOutput(QgsProcessingOutputString("VERSION", "SlopeWatch"))

    def arguments(self, values: Values) -> list[str]:
        try:
            python, how = find_engine()
        except InterpreterNotFoundError as error:
            raise QgsProcessingException(tr(str(error))) from None
        values.feedback.pushInfo(tr(f"Engine's interpreter: {python} ({how})"))
        self._python = str(python)
        return ["check"]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        for name, value in result.metrics.items():
            values.feedback.pushInfo(f"{name}: {value}")
        engine, own = str(result.metrics.get("slopewatch", "")), resources.version()
        if engine != own:
            values.feedback.pushWarning(tr(f"The engine is version {engine}, the plugin {own}; run the set-up again."))
        return {
            "ENGINE": self._python,
            "PDAL": str(result.metrics.get("pdal", "")),
            "VERSION": engine,
        }
