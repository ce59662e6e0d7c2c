"""Extract ground: a raw cloud to its ground points."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingContext, QgsProcessingFeedback

from ..interface.parameters import GroundParameters, InputParameters
from ..plugin.bridge.engine_client import EngineResult
from . import declare
from .base import SlopeWatchAlgorithm


class ExtractGround(SlopeWatchAlgorithm):
    NAME = "extractground"
    TITLE = "Extract ground"
    GROUP = "steps"
    SUMMARY = "Clips a survey to the slope, removes outliers and vegetation, and writes the ground points."
    TAGS = ("ground", "csf", "cloth", "filter", "vegetation", "denoise", "clip")
    PARAMETER_GROUPS = (GroundParameters, InputParameters)
    NUMBERS: ClassVar = {
        "RAW_POINTS": ("raw_points", "Points of the survey"),
        "RAW_AREA": ("raw_area", "Area of the survey (m²)"),
        "RAW_DENSITY": ("raw_density", "Density of the survey (points/m²)"),
        "ROI_POINTS": ("roi_points", "Points in the region of interest"),
        "ROI_AREA": ("roi_area", "Area of the region of interest (m²)"),
        "ROI_DENSITY": ("roi_density", "Density in the region of interest (points/m²)"),
        "GROUND_POINTS": ("ground_points", "Ground points"),
        "GROUND_RATIO": ("ground_ratio", "Ground points per point in the region (0 to 1)"),
        "VEGETATION_COVER": ("vegetation_cover", "Vegetation cover (0 to 1)"),
    }
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.addParameter(declare.cloud_parameter("INPUT", "Survey", "Raw point cloud of the slope, LAS or LAZ."))
        self.addParameter(
            declare.polygon_parameter(
                "ROI",
                "Region of interest",
                "Polygons of the slope, in any reference system. Larger takes longer; not set: the whole cloud.",
            )
        )
        self.addParameter(declare.profile_parameter())
        self.declare_groups()
        self.addParameter(declare.cloud_destination("OUTPUT", "Ground", "LAZ file of the ground points."))
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        arguments = ["ground", self.file(parameters, "INPUT", context)]
        arguments += self.vector_options(parameters, context, feedback, "ROI")
        arguments += ["--output", self.output_file(parameters, "OUTPUT", context)]
        arguments += declare.profile_options(self, parameters, context)
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        return {"OUTPUT": result.outputs["ground"]}
