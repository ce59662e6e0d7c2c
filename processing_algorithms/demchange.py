"""Change of elevation models: two or more DEMs to change, level of detection, zones and their series."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from qgis.core import QgsProcessingException, QgsProcessingParameterMultipleLayers, QgsProcessingParameterString

from ..interface.command_list import BASIC
from ..interface.dates import date_in_name
from ..interface.parameters import command_sets
from ..plugin.bridge.compat import RASTER
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .elevationchange import CHANGE_FILES, CHANGE_NUMBERS, CHANGE_PAGES
from .values import Values

_NOT_OF_MODELS = ("CHANGE_PROBABILITY", "CELL_SIZE", "PLANT_ERROR", "PLANT_CHANGE", "POINT_COUNTS", "OBJECTS")
_PRODUCTS = (
    *(product for product in products.CHANGE_PRODUCTS if product.name not in _NOT_OF_MODELS),
    products.Product(
        "SIGNIFICANCE",
        "significance",
        "Significance (standard errors)",
        "Elevation change of each cell over its standard error.",
        Appearance(19, visible=False, expanded=False),
        by_default=False,
    ),
    products.Product(
        "RATE",
        "rate",
        "Rate (mm/year)",
        "Rate of each cell by regression over all models; written only for three or more models whose days are known.",
        Appearance(18, visible=False, expanded=False),
        by_default=False,
    ),
)
_FEWEST = 2


class DemChange(SlopeWatchAlgorithm):
    NAME = "demchange"
    TITLE = "Change of elevation models"
    GROUP = "steps"
    SUMMARY = "Compares elevation models of two or more dates, with bias and shift taken off and a level of detection."
    TAGS = (
        "DEM", "DTM", "elevation model", "raster difference", "difference of DEMs", "DEM of difference", "DoD",
        "change detection", "erosion", "deposition", "volume", "level of detection", "coregistration", "Nuth", "bias",
        "tilt", "xDEM", "GCD", "series",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.DEMCHANGE
    BASIC = BASIC["demchange"]
    NUMBERS: ClassVar = {
        "MODEL_COUNT": ("model_count", "Number of elevation models"),
        "BIAS": ("bias_m", "Bias of the last model that was taken off (m)"),
        "BIAS_ERROR": ("bias_error_m", "Standard error of the bias (m)"),
        "SHIFT_EAST": ("shift_east_m", "Shift east that was taken off (m)"),
        "SHIFT_NORTH": ("shift_north_m", "Shift north that was taken off (m)"),
        "TILT_SIZE": ("tilt_m", "Tilt over the map between the first and the last model (m)"),
        "TILT_ERROR": ("tilt_error_m", "Standard error of the tilt (m)"),
        "BEND_SIZE": ("bend_m", "Bend over the map (m)"),
        "BEND_ERROR": ("bend_error_m", "Standard error of the bend (m)"),
        **{name: number for name, number in CHANGE_NUMBERS.items() if name != "COMMON_CELL_RATE"},
    }
    PAGES = CHANGE_PAGES
    FILES: ClassVar = {
        **CHANGE_FILES,
        "PAIRS": ("pairs", "Table of the pairs of models"),
        "ZONE_SERIES": ("zone_series", "Series of the zones (CSV)"),
    }

    def inputs(self) -> None:
        models = QgsProcessingParameterMultipleLayers("MODELS", "Elevation models", RASTER)
        models.setMinimumNumberInputs(_FEWEST)
        self.add(
            declare.with_help(
                models,
                "GeoTIFFs of two or more dates, in any projected reference system and of any cell size. They are put "
                "in order by their days where these are known, else taken in the order given, the earliest first.",
            ),
            declare.with_help(
                QgsProcessingParameterString("MODEL_DATES", "Days of the models", optional=True),
                "A day for each model as YYYY-MM-DD, in their order, separated by commas. Empty: from the files' "
                "names. Without days, rates are not known.",
            ),
        )
        self.declare_groups()
        self.add(
            declare.polygon_parameter(
                "STABLE",
                "Elevation models: stable ground",
                "Polygons of ground that has surely not moved, on which bias, shift and errors are found. Not set: "
                "stable ground is found in the models.",
                title="Elevation models",
            ),
            declare.profiles_parameter(advanced=True),
            *declare.road_parameters(),
            declare.classes_parameter(),
        )
        products.declare_folder(self, products.CHANGE_FOLDER)
        products.declare_products(self, _PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        options = values.options("STABLE", "PROFILES", *declare.LAYERS)
        return ["demchange", *self._models(values), "--output-dir", values.output_folder(), *options]

    def _models(self, values: Values) -> list[str]:
        """The files, each with its day where that is known, in order."""
        layers = self.parameterAsLayerList(values.parameters, "MODELS", values.context)
        files = [layer.source().partition("|")[0] for layer in layers]
        text = self.parameterAsString(values.parameters, "MODEL_DATES", values.context).strip()
        days = [day.strip() for day in text.split(",")] if text else [_named_day(file) for file in files]
        if len(days) != len(files):
            raise QgsProcessingException(
                f"MODEL_DATES holds {len(days)} days for {len(files)} elevation models; give one for each."
            )
        pairs = list(zip(days, files))
        if all(days):
            pairs.sort()
        return [f"{day}={file}" if day else file for day, file in pairs]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        delivered = products.deliver(_PRODUCTS, result, values, "SlopeWatch")
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}


def _named_day(file: str) -> str:
    day = date_in_name(Path(file))
    return day.isoformat() if day else ""
