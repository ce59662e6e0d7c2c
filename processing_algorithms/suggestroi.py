"""Suggest a region: the part of a cloud that is dense and whole enough to be inspected."""

from __future__ import annotations

import os
from typing import Any, ClassVar

from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

_PRODUCTS = (
    products.Product(
        "OUTPUT",
        "roi",
        "Proposed region",
        "Polygons of the region with area, density and why edges were cut.",
        Appearance(60),
        layer="roi",
    ),
)


class SuggestRoi(SlopeWatchAlgorithm):
    NAME = "suggestroi"
    TITLE = "Suggest a region of interest"
    GROUP = "tools"
    SUMMARY = (
        "Outlines the part of a survey without sparse and ragged edges, as a region of interest to correct by hand."
    )
    TAGS = ("region of interest", "roi", "boundary", "footprint", "outline", "extent", "density", "edges", "managed")
    PARAMETER_GROUPS = command_sets.SUGGESTROI
    NUMBERS: ClassVar = {
        "PARTS": ("parts", "Parts of the region"),
        "AREA": ("area_m2", "Area of the region (m²)"),
        "AREA_SHARE": ("area_share", "Share of the cloud's area (0 to 1)"),
        "POINTS_SHARE": ("points_share", "Share of the cloud's points (0 to 1)"),
        "DENSITY": ("density", "Density in the region (points/m²)"),
    }
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def inputs(self) -> None:
        self.add(declare.cloud_parameter("INPUT", "Survey", "Raw point cloud, LAS, LAZ or COPC, of any size."))
        self.declare_groups()
        self.add(products.vector_destination("OUTPUT", "Proposed region", _PRODUCTS[0].help))

    def arguments(self, values: Values) -> list[str]:
        return ["suggestroi", values.file("INPUT"), *values.options("OUTPUT")]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        name = os.path.splitext(os.path.basename(values.file("INPUT")))[0]
        return products.deliver(_PRODUCTS, result, values, f"SlopeWatch {name}")
