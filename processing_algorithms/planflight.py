"""Plan a flight: lines and waypoints over a region, and what a survey along them will show."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingParameterFeatureSource, QgsProcessingParameterMultipleLayers

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.compat import FILES, POLYGON
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

_TERRAIN_FILTER = "Elevation models and clouds (*.tif *.TIF *.tiff *.las *.LAS *.laz *.LAZ);;All files (*)"
_PLAN_FILTER = "GeoPackages (*.gpkg *.GPKG);;All files (*)"
_PRODUCTS = (
    products.Product(
        "WAYPOINTS",
        "plan",
        "Waypoints",
        "Points of the lines in the order in which they are flown, with their heights.",
        Appearance(60),
        layer="waypoints",
        file="plan.gpkg",
    ),
    products.Product(
        "LINES",
        "plan",
        "Flight lines",
        "Lines with number, battery, length, time and height over the ground.",
        Appearance(50),
        layer="lines",
        file="plan.gpkg",
    ),
    products.Product(
        "EXPECTED_LEVEL",
        "expected_level",
        "Expected level of detection (m)",
        "Change that two such surveys would show, place by place.",
        Appearance(40),
    ),
    products.Product(
        "EXPECTED_GROUND",
        "expected_ground",
        "Expected ground returns (returns/m²)",
        "Returns of the ground a square metre of map.",
        Appearance(30, visible=False, expanded=False),
    ),
    products.Product(
        "EXPECTED_RETURNS",
        "expected_returns",
        "Expected returns (returns/m²)",
        "Returns of ground and plants a square metre of map.",
        Appearance(20, visible=False, expanded=False),
    ),
    products.Product(
        "EXPECTED_MOTION",
        "expected_motion",
        "Smallest motion expected to show (m)",
        "Motion along the surface that two such surveys would show on ground of natural roughness.",
        Appearance(10, visible=False, expanded=False),
    ),
)


class PlanFlight(SlopeWatchAlgorithm):
    NAME = "planflight"
    TITLE = "Plan a flight"
    GROUP = "tools"
    SUMMARY = "Lays flight lines over a region at constant height, and says what a survey along them will show."
    TAGS = (
        "flight plan", "flight lines", "mission", "waypoints", "UAV", "drone", "LiDAR survey", "point density",
        "side overlap", "terrain following", "battery", "KML",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.PLANFLIGHT
    BASIC = BASIC["planflight"]
    NUMBERS: ClassVar = {
        "LINE_COUNT": ("line_count", "Number of lines"),
        "LINE_LENGTH": ("line_length_m", "Length of the lines (m)"),
        "FLIGHT_TIME": ("flight_time_s", "Flight time (s)"),
        "BATTERIES": ("battery_count", "Number of batteries"),
        "GROUND_DENSITY": ("ground_per_m2", "Expected ground returns (returns/m²)"),
        "LEVEL": ("level_m", "Expected level of detection (m)"),
        "MOTION": ("motion_m", "Smallest motion expected to show (m)"),
    }
    FILES: ClassVar = {
        "KML": ("kml", "Lines and waypoints (KML)"),
        "PICTURE": ("picture", "Picture of the plan"),
        "RUN_RECORD": ("run", "Run record"),
    }

    def inputs(self) -> None:
        region = QgsProcessingParameterFeatureSource("ROI", "Region of interest", [POLYGON])
        self.add(
            declare.file_parameter(
                "TERRAIN",
                "Terrain",
                "An elevation model (GeoTIFF), the surface_heights.tif of a run, whose later surface is taken, or the "
                "last survey's ground as Extract ground writes it (LAS, LAZ).",
                _TERRAIN_FILTER,
                optional=False,
            ),
            declare.with_help(region, "Polygons of the slope that is to be surveyed, in any reference system."),
            declare.cloud_parameter(
                "SURVEY",
                "Last survey",
                "The last survey with its plants. It shows how many pulses reach the ground, place by place, and how "
                "high plants stand. Not set: bare ground is assumed.",
                optional=True,
            ),
        )
        self.declare_groups()
        self.add(
            declare.in_group(
                declare.with_help(
                    QgsProcessingParameterMultipleLayers("SEASON", "Surveys of the seasons", FILES, optional=True),
                    "Classified surveys of two or more months, their dates in their names. The month in which most "
                    "pulses reached the ground is named.",
                    advanced=True,
                ),
                "Flight",
            ),
            declare.in_group(
                declare.file_parameter(
                    "PLAN",
                    "Earlier plan",
                    "The plan.gpkg of an earlier plan, whose lines are flown again with heights of this terrain. Not "
                    "set: lines are laid anew.",
                    _PLAN_FILTER,
                    advanced=True,
                ),
                "Flight",
            ),
        )
        products.declare_folder(self, "Receives plan, rasters, picture, KML and run record under fixed names.")
        products.declare_products(self, _PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        options = values.options("ROI", "SURVEY", "PLAN")
        for path in self.parameterAsFileList(values.parameters, "SEASON", values.context):
            options += ["--season", path] if path else []
        return ["planflight", values.file("TERRAIN"), "--output-dir", values.output_folder(), *options]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        delivered = products.deliver(_PRODUCTS, result, values, "SlopeWatch flight")
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}
