"""M3C2 distances: two registered ground clouds, compared along the surface's normal."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProcessingParameterFile

from ..interface.parameters import DateParameters, DistanceParameters, InputParameters, SurfaceParameters
from ..plugin.bridge.compat import FILE
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm

STABLE_HELP = (
    "Polygons of ground that has surely not moved, on which the level of detection is calibrated. Not set: stable "
    "ground is found in the distances."
)
_PRODUCTS = (
    products.Product(
        "SIGNIFICANT",
        "m3c2_significant",
        "Significant M3C2 distance (m)",
        "Mean distance of a cell's core points where it is above the level of detection; no data elsewhere.",
        Appearance(40, visible=False, expanded=False),
    ),
    products.Product(
        "DISTANCE",
        "m3c2_distance",
        "M3C2 distance (m)",
        "Mean distance of a cell's core points along their normals, later minus reference; raising is positive.",
        Appearance(30),
    ),
    products.Product(
        "LEVEL_OF_DETECTION",
        "m3c2_level_of_detection",
        "Level of detection of M3C2 (m)",
        "Smallest distance that can be told from noise, at the chosen confidence.",
        Appearance(20, visible=False, expanded=False),
        by_default=False,
    ),
)


class M3C2Distances(SlopeWatchAlgorithm):
    NAME = "m3c2distances"
    TITLE = "M3C2 distances"
    GROUP = "steps"
    SUMMARY = "Measures how far a surface has moved along its normal, and from where on that is sure."
    TAGS = ("m3c2", "distance", "change", "deformation", "cliff", "steep", "normal", "cloud to cloud")
    PARAMETER_GROUPS = (SurfaceParameters, DistanceParameters, InputParameters, DateParameters)
    NUMBERS: ClassVar = {
        "CORE_POINTS": ("core_points", "Core points"),
        "MEASURED_POINTS": ("measured_points", "Core points with a level of detection"),
        "SIGNIFICANT_POINTS": ("significant_points", "Core points with significant change"),
        "LARGEST_LOWERING": ("largest_lowering_m", "Largest significant lowering (m)"),
        "LARGEST_RAISING": ("largest_raising_m", "Largest significant raising (m)"),
        "LEVEL_MEDIAN": ("lod_median_m", "Median level of detection (m)"),
        "NORMAL_SCALE_USED": ("normal_scale_m", "Normal scale used (m)"),
        "PROJECTION_SCALE_USED": ("projection_scale_m", "Projection scale used (m)"),
        "HALF_LENGTH_USED": ("half_length_m", "Half length of the cylinder used (m)"),
    }
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.addParameter(declare.cloud_parameter("REFERENCE", "Reference", "Ground cloud of the first survey."))
        self.addParameter(declare.date_parameter("REFERENCE_DATE", "Day of the reference"))
        self.addParameter(declare.cloud_parameter("CLOUD", "Later survey", "Ground cloud of the later survey."))
        self.addParameter(declare.date_parameter("CLOUD_DATE", "Day of the later survey"))
        self.addParameter(
            declare.cloud_parameter(
                "CORE",
                "Core points",
                "Cloud of the points to measure at. Not set: points of the reference, evenly spread.",
                optional=True,
            )
        )
        self.addParameter(
            declare.with_help(
                QgsProcessingParameterFile(
                    "TRANSFORM", "Transform", FILE, optional=True, fileFilter="JSON files (*.json);;All files (*)"
                ),
                "Transform that Register epochs wrote, where the later survey has not been moved by it yet. The "
                "registration's error is taken from it.",
            )
        )
        self.addParameter(declare.polygon_parameter("STABLE", "Stable ground", STABLE_HELP, advanced=True))
        self.declare_groups()
        self.addParameter(
            declare.cloud_destination(
                "OUTPUT",
                "Core points with distances",
                "LAZ file of the core points with distance, level of detection, counts, scatter and normals.",
            )
        )
        products.declare_products(self, _PRODUCTS, "it lies beside the core points")
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        reference = self.file(parameters, "REFERENCE", context)
        cloud = self.file(parameters, "CLOUD", context)
        arguments = ["m3c2", reference, cloud, "--output", self.output_file(parameters, "OUTPUT", context)]
        arguments += self.pair_options(parameters, context)
        for option, name in (("--core", "CORE"), ("--transform", "TRANSFORM")):
            given = self.file(parameters, name, context)
            if given:
                arguments += [option, given]
        arguments += self.vector_options(parameters, context, feedback, "STABLE")
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        days = self.pair_days(parameters, context)
        group = f"SlopeWatch M3C2 {days[0]} to {days[1]}" if all(days) else "SlopeWatch M3C2"
        delivered = products.deliver(self, _PRODUCTS, result, parameters, context, group)
        return {"OUTPUT": result.outputs["points"], **delivered}
