"""Screen for hazards: one survey to labelled points, hazard zones and probabilities."""

from __future__ import annotations

import os
from typing import Any, ClassVar

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

_PRODUCTS = (
    products.Product(
        "ZONES",
        "zones",
        "Hazard zones (screening)",
        "Polygons of ground that looks raised or lowered, with area, height over the trend and confidence.",
        Appearance(50),
        layer="zones",
    ),
    products.Product(
        "PROBABILITY",
        "probability",
        "Probability of a hazard",
        "Raster whose bands are the probabilities of a hazard, of uplift and of subsidence.",
        Appearance(30, visible=False, expanded=False),
    ),
    products.Product(
        "SMALLEST_HAZARD",
        "smallest_hazard",
        "Smallest hazard (m)",
        "Raster of the height that a hazard needs to be found in 7 of 10 cases; its bands are for hazards 2, 3, 5 and "
        "8 m wide.",
        Appearance(25, visible=False, expanded=False),
    ),
)
_RASTER = (".tif", ".tiff")
_OPTIONS = {
    "ZONES": ("--zones", (".gpkg",)),
    "PROBABILITY": ("--raster", _RASTER),
    "SMALLEST_HAZARD": ("--smallest-hazard", _RASTER),
}


class ScreenHazards(SlopeWatchAlgorithm):
    NAME = "screenhazards"
    TITLE = "Screen for hazards"
    GROUP = "inspection"
    SUMMARY = "Finds ground of a single survey that looks raised or lowered against the slope around it."
    TAGS = (
        "screening", "hazard", "uplift", "subsidence", "settlement", "bulge", "network", "deep learning",
        "classification", "zones", "anomaly", "single survey",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.SCREEN
    BASIC = BASIC["screen"]
    OPTION_NAMES: ClassVar = {"raster": "PROBABILITY", "method": "SCREENING_METHOD"}
    NUMBERS: ClassVar = {
        "ZONE_COUNT": ("zone_count", "Number of hazard zones"),
        "ZONE_AREA": ("zone_area_m2", "Area of the zones on the slope (m²)"),
        "UPLIFT_ZONES": ("uplift_zones", "Number of uplift zones"),
        "SUBSIDENCE_ZONES": ("subsidence_zones", "Number of subsidence zones"),
        "GROUND_POINTS": ("ground_points", "Points that were screened"),
        "DENSITY": ("density", "Density of the ground (points/m²)"),
        "DIP": ("dip", "Dip of the slope (degrees)"),
    }
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def inputs(self) -> None:
        self.add(
            declare.cloud_parameter(
                "INPUT",
                "Ground",
                "Ground points of one survey, LAS or LAZ; or a raw survey with Ground points: extract.",
            ),
            declare.roi_parameter("all are", "Points outside are not screened"),
            declare.profile_parameter(self.PARAMETER_GROUPS),
        )
        self.declare_groups()
        self.add(*declare.road_parameters())
        self.add(
            declare.cloud_destination(
                "OUTPUT", "Labelled cloud", "LAZ copy of the input with slopewatch_class and slopewatch_prob."
            )
        )
        products.declare_products(self, _PRODUCTS, "it lies next to the labelled cloud")
        self.add(
            declare.file_destination(
                "MAP", "Map", "Picture of the labelled ground and its zones over the top view.", "PNG files (*.png)"
            )
        )

    def arguments(self, values: Values) -> list[str]:
        arguments = ["screen", values.file("INPUT"), *values.options("ROI", "CENTRELINE", "FIELD_NAMES", "OUTPUT")]
        for name, (option, endings) in _OPTIONS.items():
            # A temporary one is the file next to the labelled cloud, and another format is converted from it. Asked for
            # as a file, because asking for a layer would have it loaded.
            wanted = self.parameterAsFileOutput(values.parameters, name, values.context)
            if wanted and wanted.lower().endswith(endings) and not products.is_temporary(wanted):
                arguments += [option, os.path.abspath(wanted)]
        return [*arguments, *values.options("MAP")]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        name = os.path.splitext(os.path.basename(values.file("INPUT")))[0]
        delivered = products.deliver(_PRODUCTS, result, values, f"SlopeWatch {name}")
        return {"OUTPUT": result.outputs["labelled"], "MAP": result.outputs["map"], **delivered}
