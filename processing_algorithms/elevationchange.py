"""Elevation change: two registered ground clouds to rasters and hazard zones."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProcessingParameterFile

from ..interface.parameters import (
    ChangeParameters,
    DateParameters,
    HeatmapParameters,
    InputParameters,
    OutputParameters,
    ReportParameters,
    SurfaceParameters,
    ZoneParameters,
)
from ..plugin.bridge.compat import FILE
from ..plugin.bridge.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm

STABLE_HELP = (
    "Polygons of ground that has surely not moved, on which the errors are calibrated. Not set: stable ground is found "
    "in the surveys."
)
CHANGE_NUMBERS = {
    "ZONE_COUNT": ("zone_count", "Number of hazard zones"),
    "ZONE_AREA": ("zone_area_m2", "Area of the zones (m²)"),
    "LOSS": ("vol_loss_m3", "Volume lost in the zones (m³)"),
    "GAIN": ("vol_gain_m3", "Volume gained in the zones (m³)"),
    "LOSS_ERROR": ("vol_loss_err_m3", "Standard error of the volume lost (m³)"),
    "GAIN_ERROR": ("vol_gain_err_m3", "Standard error of the volume gained (m³)"),
    "LARGEST_SINK": ("largest_sink_m", "Largest lowering in a zone (m)"),
    "LARGEST_RISE": ("largest_rise_m", "Largest raising in a zone (m)"),
    "COMPARED_SHARE": ("compared_share", "Ground that was compared (0 to 1)"),
    "COMMON_CELL_RATE": ("common_cell_rate", "Cells with points of both surveys (0 to 1)"),
    "LEVEL_MEDIAN": ("lod_median_m", "Median level of detection (m)"),
}
CHANGE_PAGES = {"REPORT": ("report", "Report")}
CHANGE_FILES = {
    "VOLUMES": ("volumes", "Table of areas and volumes"),
    "HEATMAP_PICTURE": ("heatmap", "Heatmap picture"),
    "RUN_RECORD": ("run", "Run record"),
}


class ElevationChange(SlopeWatchAlgorithm):
    NAME = "elevationchange"
    TITLE = "Elevation change"
    GROUP = "steps"
    SUMMARY = "Subtracts two registered ground clouds and outlines where the change is significant."
    TAGS = ("change", "difference", "dod", "deformation", "volume", "hazard", "zones", "heatmap")
    PARAMETER_GROUPS = (
        SurfaceParameters,
        ChangeParameters,
        ZoneParameters,
        HeatmapParameters,
        ReportParameters,
        InputParameters,
        DateParameters,
        OutputParameters,
    )
    NUMBERS = CHANGE_NUMBERS
    PAGES = CHANGE_PAGES
    FILES = CHANGE_FILES

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.addParameter(declare.cloud_parameter("REFERENCE", "Reference", "Ground cloud of the first survey."))
        self.addParameter(declare.date_parameter("REFERENCE_DATE", "Day of the reference"))
        self.addParameter(declare.cloud_parameter("CLOUD", "Later survey", "Ground cloud of the later survey."))
        self.addParameter(declare.date_parameter("CLOUD_DATE", "Day of the later survey"))
        self.addParameter(
            declare.with_help(
                QgsProcessingParameterFile(
                    "TRANSFORM", "Transform", FILE, optional=True, fileFilter="JSON files (*.json);;All files (*)"
                ),
                "Transform that Register epochs wrote, where the later survey has not been moved by it yet.",
            )
        )
        self.addParameter(declare.polygon_parameter("STABLE", "Stable ground", STABLE_HELP, advanced=True))
        self.addParameter(declare.profiles_parameter())
        self.addParameter(declare.profile_parameter())
        self.declare_groups()
        products.declare_folder(
            self, "Receives the rasters, hazard zones, heatmap, report and run record under fixed names."
        )
        products.declare_products(self, products.CHANGE_PRODUCTS)
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        reference = self.file(parameters, "REFERENCE", context)
        cloud = self.file(parameters, "CLOUD", context)
        self._folder = products.output_folder(self, parameters, context)
        arguments = ["change", reference, cloud, "--output-dir", self._folder]
        arguments += self.pair_options(parameters, context)
        transform = self.file(parameters, "TRANSFORM", context)
        if transform:
            arguments += ["--transform", transform]
        arguments += self.vector_options(parameters, context, feedback, "STABLE", "PROFILES")
        arguments += declare.profile_options(self, parameters, context)
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        days = self.pair_days(parameters, context)
        group = f"SlopeWatch {days[0]} to {days[1]}" if all(days) else "SlopeWatch"
        delivered = products.deliver(self, products.CHANGE_PRODUCTS, result, parameters, context, group)
        return {"OUTPUT_FOLDER": self._folder, **delivered}
