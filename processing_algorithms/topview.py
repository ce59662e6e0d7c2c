"""Top view: a raw cloud as rasters to draw on."""

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
        "TOP_VIEW",
        "top_view",
        "Top view",
        "Picture from straight above in the cloud's colours, else its intensity, else its relief.",
        Appearance(50),
    ),
    products.Product(
        "HILLSHADE_RASTER",
        "hillshade",
        "Hillshade",
        "Relief of the lowest or the highest returns, lit from four sides.",
        Appearance(40, visible=False, expanded=False),
    ),
    products.Product(
        "DENSITY",
        "density",
        "Density (returns/m²)",
        "Returns per square metre.",
        Appearance(30, visible=False, expanded=False),
    ),
    products.Product(
        "GROUND_DENSITY",
        "ground_density",
        "Ground density (returns/m²)",
        "Ground returns per square metre: those of class 2, or those near a quick estimate of the ground.",
        Appearance(20, visible=False, expanded=False),
    ),
    products.Product(
        "CANOPY_HEIGHT",
        "canopy_height",
        "Canopy height (m)",
        "Height of the highest return over the ground.",
        Appearance(10, visible=False, expanded=False),
    ),
)


class TopView(SlopeWatchAlgorithm):
    NAME = "topview"
    TITLE = "Top view"
    GROUP = "tools"
    SUMMARY = "Shows a raw survey from above as rasters to draw on: picture, hillshade, densities, canopy height."
    TAGS = ("orthophoto", "hillshade", "density", "canopy height model", "chm", "intensity", "preview", "digitise")
    PARAMETER_GROUPS = command_sets.TOPVIEW
    NUMBERS: ClassVar = {
        "POINTS": ("points", "Points"),
        "CELL_USED": ("cell_m", "Cell size (m)"),
        "AREA": ("area_m2", "Area with returns (m²)"),
        "MEDIAN_DENSITY": ("density", "Median density (returns/m²)"),
        "MEDIAN_GROUND_DENSITY": ("ground_density", "Median ground density (returns/m²)"),
    }
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def inputs(self) -> None:
        self.add(
            declare.cloud_parameter("INPUT", "Survey", "Raw point cloud, LAS, LAZ or COPC, of any size."),
            declare.roi_parameter("the whole cloud"),
        )
        self.declare_groups()
        products.declare_folder(self, "Receives the rasters and the run record under fixed names.")
        products.declare_products(self, _PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        return ["topview", values.file("INPUT"), "--output-dir", values.output_folder(), *values.options("ROI")]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        name = os.path.splitext(os.path.basename(values.file("INPUT")))[0]
        delivered = products.deliver(_PRODUCTS, result, values, f"SlopeWatch top view of {name}")
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}
