"""Elevation change: two registered ground clouds to rasters and hazard zones."""

from __future__ import annotations

from typing import Any

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

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
    "REPORT_PDF": ("report_pdf", "Report to sign (PDF)"),
    "VOLUMES": ("volumes", "Table of areas and volumes"),
    "HEATMAP_PICTURE": ("heatmap", "Heatmap picture"),
    "CLASS_TABLE": ("budget_by_class", "Table of the change by class"),
    "RUN_RECORD": ("run", "Run record"),
}


class ElevationChange(SlopeWatchAlgorithm):
    NAME = "elevationchange"
    TITLE = "Elevation change"
    GROUP = "steps"
    SUMMARY = "Subtracts two registered ground clouds and outlines where the change is significant."
    TAGS = (
        "change detection", "difference of DEMs", "DEM of difference", "DoD", "subtract", "deformation", "settlement",
        "subsidence", "uplift", "erosion", "cut and fill", "cut fill", "volume", "earthworks", "level of detection",
        "hazard", "zones", "heatmap",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.CHANGE
    BASIC = BASIC["change"]
    NUMBERS = CHANGE_NUMBERS
    PAGES = CHANGE_PAGES
    FILES = CHANGE_FILES

    def inputs(self) -> None:
        self.add(
            *declare.survey_parameters("Reference", "Ground cloud of the {} survey."),
            declare.transform_parameter(),
            declare.profile_parameter(self.PARAMETER_GROUPS),
        )
        self.declare_groups()
        self.add(
            declare.polygon_parameter("STABLE", "Change: stable ground", STABLE_HELP, advanced=True, title="Change"),
            declare.profiles_parameter(advanced=True),
            *declare.road_parameters(),
            declare.classes_parameter(),
        )
        products.declare_folder(self, products.CHANGE_FOLDER)
        products.declare_products(self, products.CHANGE_PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        surveys = [values.file("REFERENCE"), values.file("CLOUD")]
        options = [*values.pair_options(), *values.options("TRANSFORM", "STABLE", "PROFILES", *declare.LAYERS)]
        return ["change", *surveys, "--output-dir", values.output_folder(), *options]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        days = values.pair_days()
        group = f"SlopeWatch {days[0]} to {days[1]}" if all(days) else "SlopeWatch"
        delivered = products.deliver(products.CHANGE_PRODUCTS, result, values, group)
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}
