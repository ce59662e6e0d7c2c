"""Displacement vectors: two registered ground clouds to motion along the surface."""

from __future__ import annotations

from typing import Any, ClassVar

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

STABLE_HELP = (
    "Polygons of ground that has surely not moved; its motion is an error of the registration and is taken off all "
    "vectors. Not set: nothing is taken off."
)
FOLDER = "Receives the rasters, vectors, zones, report and run record under fixed names."


class DisplacementVectors(SlopeWatchAlgorithm):
    NAME = "displacementvectors"
    TITLE = "Displacement vectors"
    GROUP = "steps"
    SUMMARY = "Measures how far ground has moved along its surface, with errors, and outlines what moves as one."
    TAGS = (
        "displacement", "vector", "motion", "creep", "slide", "sliding", "landslide", "deformation", "velocity",
        "feature tracking", "image correlation", "optical flow", "arrows", "movement",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.DISPLACEMENT
    BASIC = BASIC["displacement"]
    NUMBERS: ClassVar = {
        "ZONE_COUNT": ("moving_zone_count", "Zones of coherent motion"),
        "ZONE_AREA": ("moving_area_m2", "Area of the zones (m²)"),
        "FASTEST_ZONE": ("fastest_zone_m", "Largest motion of a zone (m)"),
        "VECTOR_COUNT": ("significant_vectors", "Significant vectors"),
        "MEASURED_SHARE": ("measured_share", "Ground on which motion can be measured (0 to 1)"),
        "SMALLEST_MEDIAN": ("smallest_motion_median_m", "Median of the smallest motion that can be told (m)"),
    }
    PAGES: ClassVar = {"REPORT": ("report", "Report")}
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def inputs(self) -> None:
        self.add(
            *declare.survey_parameters("Reference", "Ground cloud of the {} survey."),
            declare.transform_parameter(" The registration's error is taken from it."),
        )
        self.declare_groups()
        self.add(
            declare.polygon_parameter(
                "STABLE", "Displacement: stable ground", STABLE_HELP, advanced=True, title="Displacement"
            ),
            *declare.road_parameters(),
        )
        products.declare_folder(self, FOLDER)
        products.declare_products(self, products.MOTION_PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        surveys = [values.file("REFERENCE"), values.file("CLOUD")]
        options = [*values.pair_options(), *values.options("TRANSFORM", "STABLE", "CENTRELINE", "FIELD_NAMES")]
        return ["displacement", *surveys, "--output-dir", values.output_folder(), *options]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        days = values.pair_days()
        group = f"SlopeWatch motion {days[0]} to {days[1]}" if all(days) else "SlopeWatch motion"
        delivered = products.deliver(products.MOTION_PRODUCTS, result, values, group)
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}
