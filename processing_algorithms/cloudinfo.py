"""Cloud information: what a point cloud holds, and what is unusual about it."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingException, QgsProcessingOutputString

from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.words import tr
from . import declare
from .base import SlopeWatchAlgorithm
from .values import Values


class CloudInfo(SlopeWatchAlgorithm):
    NAME = "cloudinfo"
    TITLE = "Cloud information"
    GROUP = "tools"
    SUMMARY = "Lists what a point cloud holds, and what is unusual about it."
    TAGS = ("info", "header", "metadata", "density", "classes", "reference system", "quality")
    PARAMETER_GROUPS = command_sets.INFO
    NUMBERS: ClassVar = {
        "POINTS": ("points", "Points"),
        "AREA": ("area", "Area (m²)"),
        "DENSITY": ("density", "Density (points/m²)"),
    }

    def inputs(self) -> None:
        self.add(declare.cloud_parameter("INPUT", "Point cloud", "LAS or LAZ file to look at."))
        self.declare_groups()
        self.addOutput(QgsProcessingOutputString("REFERENCE_SYSTEM", "Reference system"))
        self.addOutput(QgsProcessingOutputString("UNUSUAL", "What is unusual"))

    def arguments(self, values: Values) -> list[str]:
        cloud = values.file("INPUT")
        if not cloud:
            raise QgsProcessingException("INPUT is empty; give the point cloud to look at.")
        return ["info", cloud]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        facts = dict(result.metrics)
        sentences = [str(sentence) for sentence in facts.pop("warnings", [])]
        for name, value in facts.items():
            for line in _lines(name, value):
                values.feedback.pushInfo(line)
        for sentence in sentences:
            values.feedback.pushWarning(tr(sentence))
        system = facts.get("reference_system") or {}
        return {"REFERENCE_SYSTEM": str(system.get("declared") or ""), "UNUSUAL": "\n".join(sentences)}


def _lines(name: str, value: Any) -> list[str]:
    """A fact in words; those of a table one a line."""
    if isinstance(value, dict):
        return [f"{name}, {part}: {held}" for part, held in value.items()]
    if isinstance(value, list):
        return [f"{name}: {' to '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in value)}"]
    return [f"{name}: {value:.6g}" if isinstance(value, float) else f"{name}: {value}"]
