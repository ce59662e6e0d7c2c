"""Simulate a series: dated clouds of an invented slope with creeping zones, to try an inspection of a series on."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingContext, QgsProcessingFeedback

from ..engine.parameters import CreepParameters
from ..plugin.engine_client import EngineResult
from ..plugin.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm

_PRODUCTS = (
    products.Product("ROI", "roi", "Region of interest", "Polygon of the cut face.", Appearance(20), layer="roi"),
    products.Product(
        "TRUTH_VELOCITY",
        "truth_velocity",
        "True velocity (mm/day)",
        "The vertical velocity that was put into the surveys, as an inspection of the series should find it.",
        Appearance(10),
        by_default=False,
    ),
)


class SimulateSeries(SlopeWatchAlgorithm):
    NAME = "simulateseries"
    TITLE = "Simulate a series"
    GROUP = "tools"
    SUMMARY = "Writes dated simulated surveys of one cut slope, of which zones creep at known velocities."
    TAGS = ("simulation", "synthetic", "test data", "truth", "creep", "velocity", "time series")
    PARAMETER_GROUPS = (CreepParameters,)
    FILES: ClassVar = {
        "MANIFEST": ("manifest", "Manifest"),
        "TRUTH": ("truth", "Truth"),
        "RUN_RECORD": ("run", "Run record"),
    }

    def initAlgorithm(self, configuration: Any = None) -> None:
        basic = ("seed", "points", "length", "height", "vegetation", "surveys", "interval", "velocities", "onset")
        self.declare_groups(basic=basic)
        products.declare_folder(self, "Receives the surveys, a manifest, the region of interest and the truth.")
        products.declare_products(self, _PRODUCTS)
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        self._folder = products.output_folder(self, parameters, context)
        arguments = ["simulate", "series", "--output-dir", self._folder]
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        delivered = products.deliver(self, _PRODUCTS, result, parameters, context, "SlopeWatch simulated series")
        return {"OUTPUT_FOLDER": self._folder, **delivered}
