"""Simulate a survey: two clouds of an invented slope with known change, to try SlopeWatch and to check it."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingContext, QgsProcessingFeedback

from ..engine.parameters import SurveyParameters
from ..plugin.engine_client import EngineResult
from ..plugin.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm

_PRODUCTS = (
    products.Product("ROI", "roi", "Region of interest", "Polygon of the cut face.", Appearance(20), layer="roi"),
    products.Product(
        "TRUTH_DZ",
        "truth_dz",
        "True elevation change (m)",
        "The change that was put into the later survey.",
        Appearance(10),
        by_default=False,
    ),
)


class SimulateSurvey(SlopeWatchAlgorithm):
    NAME = "simulatesurvey"
    TITLE = "Simulate a survey"
    GROUP = "tools"
    SUMMARY = "Writes two simulated UAV LiDAR surveys of one cut slope with known change and offset."
    TAGS = ("simulation", "synthetic", "test data", "truth", "demo")
    PARAMETER_GROUPS = (SurveyParameters,)
    FILES: ClassVar = {
        "REFERENCE": ("reference", "First survey"),
        "CLOUD": ("cloud", "Later survey"),
        "TRUTH": ("truth", "Truth"),
        "TRUTH_TRANSFORM": ("truth_transform", "True transform"),
        "RUN_RECORD": ("run", "Run record"),
    }

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.declare_groups(basic=("seed", "points", "length", "height", "angle", "vegetation", "amplitude"))
        products.declare_folder(self, "Receives both surveys, the region of interest and the truth.")
        products.declare_products(self, _PRODUCTS)
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        self._folder = products.output_folder(self, parameters, context)
        arguments = ["simulate", "survey", "--output-dir", self._folder]
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        delivered = products.deliver(self, _PRODUCTS, result, parameters, context, "SlopeWatch simulated survey")
        return {"OUTPUT_FOLDER": self._folder, **delivered}
