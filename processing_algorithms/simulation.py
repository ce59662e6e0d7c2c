"""What the tools that simulate have in common: parameters and a folder in, files and layers of the folder out."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsProcessingContext, QgsProcessingFeedback

from ..plugin.bridge.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm


class SimulationAlgorithm(SlopeWatchAlgorithm):
    """``slopewatch simulate KIND``; a subclass says what is in the folder."""

    GROUP = "tools"
    KIND = ""
    FOLDER_HELP = ""
    #: parameters that are not advanced; None: all
    BASIC: tuple[str, ...] | None = None
    PRODUCTS: tuple[products.Product, ...] = ()
    #: name of the group of layers
    LAYERS = ""

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.declare_groups(basic=self.BASIC)
        products.declare_folder(self, self.FOLDER_HELP)
        products.declare_products(self, self.PRODUCTS)
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        self._folder = products.output_folder(self, parameters, context)
        arguments = ["simulate", self.KIND, "--output-dir", self._folder]
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        delivered = products.deliver(self, self.PRODUCTS, result, parameters, context, self.LAYERS)
        return {"OUTPUT_FOLDER": self._folder, **delivered}
