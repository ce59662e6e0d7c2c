"""Compare a flight with its plan: lines left out or flown elsewhere, and places that fell short."""

from __future__ import annotations

from typing import Any, ClassVar

from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

_PLAN_FILTER = "GeoPackages (*.gpkg *.GPKG);;All files (*)"
_PRODUCTS = (
    products.Product(
        "PLACES",
        "comparison",
        "Returns promised and reached",
        "Places with the returns promised and reached, and which fell short by more than 15 %.",
        Appearance(40),
        layer="places",
        file="comparison.gpkg",
    ),
)


class CompareFlight(SlopeWatchAlgorithm):
    NAME = "compareflight"
    TITLE = "Compare a flight with its plan"
    GROUP = "tools"
    SUMMARY = (
        "Says which planned lines were left out or flown elsewhere, and where a survey has fewer returns than planned."
    )
    TAGS = (
        "flight plan", "flown lines", "trajectory", "coverage", "point density", "quality control", "acceptance",
        "UAV", "drone", "LiDAR survey",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.COMPAREFLIGHT
    NUMBERS: ClassVar = {
        "LINES_PLANNED": ("planned_lines", "Number of planned lines"),
        "LINES_FLOWN": ("flown_lines", "Number of lines flown"),
        "COVERED_SHARE": ("covered_share", "Share of the places with returns"),
        "RETURNS_RATIO": ("returns_ratio", "Returns reached, as a share of those promised"),
        "GROUND_RATIO": ("ground_ratio", "Ground returns reached, as a share of those promised"),
        "SHORT_PLACES": ("short_places", "Number of places that fell short"),
    }
    FILES: ClassVar = {
        "COMPARISON": ("comparison", "Lines, way flown and places (GeoPackage)"),
        "STRIPS_TABLE": ("strips", "Table of the strips"),
        "RUN_RECORD": ("run", "Run record"),
    }

    def inputs(self) -> None:
        self.add(
            declare.file_parameter("PLAN", "Plan", "The plan.gpkg of Plan a flight.", _PLAN_FILTER, optional=False),
            declare.cloud_parameter("INPUT", "Survey flown", "The survey as flown, with all its returns."),
            declare.cloud_parameter(
                "GROUND",
                "Its ground",
                "The survey's ground as Extract ground writes it. Not set: the survey's points of class 2.",
                optional=True,
            ),
            declare.file_parameter(
                "TRAJECTORY",
                "Trajectory",
                "CSV file with columns time, x, y and z of the carrier, in the plan's reference system. Not set: its "
                "way is taken from the scan angles where these show it.",
                declare.CSV_FILTER,
            ),
        )
        self.declare_groups()
        products.declare_folder(self, "Receives layers, tables and run record under fixed names.")
        products.declare_products(self, _PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        options = values.options("GROUND", "TRAJECTORY")
        plan, cloud = values.file("PLAN"), values.file("INPUT")
        return ["compareflight", plan, cloud, "--output-dir", values.output_folder(), *options]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        delivered = products.deliver(_PRODUCTS, result, values, "SlopeWatch flight flown")
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}
