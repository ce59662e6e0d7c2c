"""Extract ground: a raw cloud to its ground points."""

from __future__ import annotations

from typing import Any, ClassVar

from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from . import declare
from .base import SlopeWatchAlgorithm
from .values import Values


class ExtractGround(SlopeWatchAlgorithm):
    NAME = "extractground"
    TITLE = "Extract ground"
    GROUP = "steps"
    SUMMARY = "Clips a survey to the slope, removes outliers and vegetation, and writes the ground points."
    TAGS = (
        "ground filter", "ground classification", "bare earth", "DTM", "csf", "cloth simulation",
        "vegetation removal", "denoise", "outliers", "clip",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.GROUND
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

    def inputs(self) -> None:
        self.add(
            declare.cloud_parameter("INPUT", "Survey", "Raw point cloud of the slope, LAS or LAZ."),
            declare.roi_parameter("the whole cloud"),
            declare.profile_parameter(self.PARAMETER_GROUPS),
        )
        self.declare_groups()
        self.add(declare.cloud_destination("OUTPUT", "Ground", "LAZ file of the ground points."))

    def arguments(self, values: Values) -> list[str]:
        return ["ground", values.file("INPUT"), *values.options("ROI", "OUTPUT")]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        return {"OUTPUT": result.outputs["ground"]}
