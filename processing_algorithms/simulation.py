"""What the tools that simulate have in common: parameters and a folder in, files and layers of the folder out."""

from __future__ import annotations

from typing import Any

from ..plugin.bridge.engine_client import EngineResult
from . import products
from .base import SlopeWatchAlgorithm
from .values import Values


class SimulationAlgorithm(SlopeWatchAlgorithm):
    """``slopewatch simulate KIND``; a subclass says what is in the folder."""

    GROUP = "tools"
    KIND = ""
    FOLDER_HELP = ""
    PRODUCTS: tuple[products.Product, ...] = ()
    #: name of the group of layers
    LAYERS = ""

    def inputs(self) -> None:
        self.declare_groups()
        products.declare_folder(self, self.FOLDER_HELP)
        products.declare_products(self, self.PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        return ["simulate", self.KIND, "--output-dir", values.output_folder()]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        delivered = products.deliver(self.PRODUCTS, result, values, self.LAYERS)
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}
