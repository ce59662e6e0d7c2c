"""Locate on the road: route, chainage, side and offset of the features of a layer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from qgis.core import QgsProcessingParameterFeatureSource, QgsProcessingParameterVectorDestination

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.compat import ANY_SHAPE
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

_PRODUCTS = (
    products.Product(
        "OUTPUT",
        "located",
        "Located features",
        "The layer with route, chain_from, chain_to, side, carriageway, offset_m, offset_mid_m, location and "
        "location_note, or your names of these.",
        Appearance(60),
        layer="located",
    ),
)


class LocateOnRoad(SlopeWatchAlgorithm):
    NAME = "locateonroad"
    TITLE = "Locate on the road"
    GROUP = "steps"
    SUMMARY = (
        "Gives zones, regions or any other features their route, chainage, side and offset by a road's centreline."
    )
    TAGS = (
        "chainage", "station", "stationing", "centreline", "centerline", "linear referencing", "LRS", "kilometre",
        "milepost", "offset", "side", "route", "road", "axis", "zones", "asset",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.LOCATE
    BASIC = BASIC["locate"]
    OPTION_NAMES: ClassVar = {"layer": "INPUT"}
    NUMBERS: ClassVar = {
        "FEATURES": ("features", "Number of features"),
        "LOCATED": ("located", "Features with a place"),
        "NOT_LOCATED": ("not_located", "Features without a place"),
    }
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def inputs(self) -> None:
        self.add(
            declare.with_help(
                QgsProcessingParameterFeatureSource("INPUT", "Layer", [ANY_SHAPE]),
                "Polygons, lines or points, such as the hazard zones of a former run, in any reference system.",
            ),
            declare.centreline_parameter(optional=False),
            declare.field_names_parameter(advanced=False),
        )
        self.declare_groups()
        help_text = _PRODUCTS[0].help
        destination = QgsProcessingParameterVectorDestination("OUTPUT", "Located features", ANY_SHAPE)
        self.add(declare.with_help(destination, f"{help_text} A GeoPackage (.gpkg)."))

    def arguments(self, values: Values) -> list[str]:
        path, layer = values.source_layer("INPUT")
        named = ["--layer", layer] if layer else []
        return ["locate", path, *named, *values.options("CENTRELINE", "FIELD_NAMES", "OUTPUT")]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        product = replace(_PRODUCTS[0], layer=str(result.metrics["layer"]))
        return products.deliver((product,), result, values, "SlopeWatch located")
