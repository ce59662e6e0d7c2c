"""Screen for hazards: one survey to labelled points, hazard zones and probabilities."""

from __future__ import annotations

import os
from typing import Any, ClassVar

from qgis.core import (
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterFileDestination,
    QgsProcessingUtils,
)

from ..interface.parameters import GroundParameters, InputParameters, ScreeningParameters
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm

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
)
_OPTIONS = {"ZONES": ("--zones", (".gpkg",)), "PROBABILITY": ("--raster", (".tif", ".tiff"))}
_BASIC = ("screening_method", "ground", "minimum_probability", "minimum_hazard_area", "probability_cell")


class ScreenHazards(SlopeWatchAlgorithm):
    NAME = "screenhazards"
    TITLE = "Screen for hazards"
    GROUP = "inspection"
    SUMMARY = "Finds ground of a single survey that looks raised or lowered against the slope around it."
    TAGS = ("screening", "hazard", "uplift", "subsidence", "network", "classification", "zones")
    PARAMETER_GROUPS = (ScreeningParameters, GroundParameters, InputParameters)
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

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.addParameter(
            declare.cloud_parameter(
                "INPUT",
                "Ground",
                "Ground points of one survey, LAS or LAZ; or a raw survey with Ground points: extract.",
            )
        )
        self.addParameter(
            declare.polygon_parameter(
                "ROI",
                "Region of interest",
                "Polygons of the slope, in any reference system. Points outside are not screened; not set: all are.",
            )
        )
        self.addParameter(declare.profile_parameter())
        self.declare_groups(basic=_BASIC, prefixes={"ground": "Extraction"})
        self.addParameter(
            declare.cloud_destination(
                "OUTPUT", "Labelled cloud", "LAZ copy of the input with slopewatch_class and slopewatch_prob."
            )
        )
        products.declare_products(self, _PRODUCTS, "it lies beside the labelled cloud")
        self.addParameter(
            declare.with_help(
                QgsProcessingParameterFileDestination(
                    "MAP", "Map", "PNG files (*.png)", optional=True, createByDefault=True
                ),
                "Picture of the labelled ground and its zones over the top view.",
            )
        )
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        arguments = ["screen", self.file(parameters, "INPUT", context)]
        arguments += self.vector_options(parameters, context, feedback, "ROI")
        arguments += ["--output", self.output_file(parameters, "OUTPUT", context)]
        for name, (option, endings) in _OPTIONS.items():
            # A temporary one is the file next to the labelled cloud, and another format is converted from it. Asked for
            # as a file, because asking for a layer would have it loaded.
            wanted = self.parameterAsFileOutput(parameters, name, context)
            if wanted and wanted.lower().endswith(endings) and not _temporary(wanted):
                arguments += [option, os.path.abspath(wanted)]
        picture = self.output_file(parameters, "MAP", context)
        if picture:
            arguments += ["--map", picture]
        arguments += declare.profile_options(self, parameters, context)
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        name = os.path.splitext(os.path.basename(self.file(parameters, "INPUT", context)))[0]
        delivered = products.deliver(self, _PRODUCTS, result, parameters, context, f"SlopeWatch {name}")
        return {"OUTPUT": result.outputs["labelled"], "MAP": result.outputs["map"], **delivered}


def _temporary(path: str) -> bool:
    folder = os.path.realpath(QgsProcessingUtils.tempFolder())
    return os.path.realpath(path).startswith(folder + os.sep)
