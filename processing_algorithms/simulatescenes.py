"""Simulate scenes: slopes of one epoch whose every point has a known class, to train on and to score with."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingContext, QgsProcessingFeedback

from ..engine.parameters import ScenesParameters
from ..plugin.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm


class SimulateScenes(SlopeWatchAlgorithm):
    NAME = "simulatescenes"
    TITLE = "Simulate labelled scenes"
    GROUP = "tools"
    SUMMARY = "Writes simulated slopes with bulges, hollows and what looks like them, the class of every point known."
    TAGS = ("simulation", "synthetic", "labels", "truth", "training data", "hazard", "benchmark")
    PARAMETER_GROUPS = (ScenesParameters,)
    FILES: ClassVar = {
        "SCENE": ("scene", "First scene"),
        "HAZARDS": ("hazards", "Hazards"),
        "MANIFEST": ("manifest", "Manifest"),
        "PICTURE_FILE": ("picture", "Picture"),
        "RUN_RECORD": ("run", "Run record"),
    }
    NUMBERS: ClassVar = {
        "SCENES": ("scenes", "Scenes"),
        "POINTS": ("points", "Points"),
        "HAZARD_COUNT": ("hazards", "Hazards"),
        "SHARE_BACKGROUND": ("share_background", "Share of background (0 to 1)"),
        "SHARE_UPLIFT": ("share_uplift", "Share of uplift (0 to 1)"),
        "SHARE_SUBSIDENCE": ("share_subsidence", "Share of subsidence (0 to 1)"),
    }

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.declare_groups()
        products.declare_folder(self, "Receives the scenes, their hazards, a picture and a manifest.")
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        self._folder = products.output_folder(self, parameters, context)
        arguments = ["simulate", "scenes", "--output-dir", self._folder]
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        return {"OUTPUT_FOLDER": self._folder}
