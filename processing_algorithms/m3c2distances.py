"""M3C2 distances: two registered ground clouds, compared along the surface's normal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

STABLE_HELP = (
    "Polygons of ground that has surely not moved, on which the level of detection is calibrated. Not set: stable "
    "ground is found in the distances."
)
_OF_CHANGE = {product.name: product for product in products.CHANGE_PRODUCTS}
_PRODUCTS = (
    products.Product(
        "ZONES",
        "m3c2_zones",
        "Hazard zones",
        "Polygons of contiguous significant distances, seen from above, with area and volume of the surface.",
        Appearance(50),
        layer="zones",
    ),
    *(replace(_OF_CHANGE[name], key="m3c2_zones", by_default=False) for name in ("FOOTPRINTS", "UNSURE")),
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
        "Smallest distance that can be distinguished from noise, at the chosen confidence.",
        Appearance(20, visible=False, expanded=False),
        by_default=False,
    ),
)


class M3C2Distances(SlopeWatchAlgorithm):
    NAME = "m3c2distances"
    TITLE = "M3C2 distances"
    GROUP = "steps"
    SUMMARY = "Measures how far a surface has moved along its normal, where that is sure, and the volume of each zone."
    TAGS = (
        "m3c2", "distance", "change detection", "deformation", "cliff", "rock face", "steep", "normal",
        "cloud to cloud", "C2C", "cloud comparison",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.M3C2
    BASIC = BASIC["m3c2"]
    NUMBERS: ClassVar = {
        "CORE_POINTS": ("core_points", "Core points"),
        "MEASURED_POINTS": ("measured_points", "Core points with a level of detection"),
        "SIGNIFICANT_POINTS": ("significant_points", "Core points with significant change"),
        "ZONE_COUNT": ("zone_count", "Hazard zones"),
        "VOLUME_LOST": ("vol_loss_m3", "Volume lost (m³)"),
        "VOLUME_GAINED": ("vol_gain_m3", "Volume gained (m³)"),
        "LARGEST_LOWERING": ("largest_lowering_m", "Largest significant lowering (m)"),
        "LARGEST_RAISING": ("largest_raising_m", "Largest significant raising (m)"),
        "LEVEL_MEDIAN": ("lod_median_m", "Median level of detection (m)"),
        "NORMAL_SCALE_USED": ("normal_scale_m", "Normal scale used (m)"),
        "PROJECTION_SCALE_USED": ("projection_scale_m", "Projection scale used (m)"),
        "HALF_LENGTH_USED": ("half_length_m", "Half length of the cylinder used (m)"),
    }
    PAGES: ClassVar = {"REPORT": ("report", "Report")}
    FILES: ClassVar = {
        "REPORT_PDF": ("report_pdf", "Report to sign (PDF)"),
        "VOLUMES": ("m3c2_volumes", "Table of areas and volumes"),
        "FACE_PICTURE": ("m3c2_face", "Picture of the face"),
        "RUN_RECORD": ("run", "Run record"),
    }

    def inputs(self) -> None:
        self.add(
            *declare.survey_parameters("Reference", "Ground cloud of the {} survey."),
            declare.cloud_parameter(
                "CORE",
                "Core points",
                "Cloud of the points to measure at. Not set: points of the reference, evenly spread.",
                optional=True,
            ),
            declare.roi_parameter("the whole clouds", "Core points outside are left out"),
            declare.transform_parameter(" The registration's error is taken from it."),
        )
        self.declare_groups()
        self.add(
            declare.polygon_parameter(
                "STABLE", "Distances: stable ground", STABLE_HELP, advanced=True, title="Distances"
            ),
            declare.cloud_destination(
                "OUTPUT",
                "Core points with distances",
                "LAZ file of the core points with distance, level of detection, counts, scatter and normals.",
            ),
        )
        products.declare_products(self, _PRODUCTS, "it lies next to the core points")

    def arguments(self, values: Values) -> list[str]:
        surveys = [values.file("REFERENCE"), values.file("CLOUD")]
        options = [*values.pair_options(), *values.options("CORE", "ROI", "TRANSFORM", "STABLE")]
        return ["m3c2", *surveys, "--output", values.output_file("OUTPUT"), *options]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        days = values.pair_days()
        group = f"SlopeWatch M3C2 {days[0]} to {days[1]}" if all(days) else "SlopeWatch M3C2"
        delivered = products.deliver(_PRODUCTS, result, values, group)
        return {"OUTPUT": result.outputs["points"], **delivered}
