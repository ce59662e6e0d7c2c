"""Inspect slope: two raw surveys to rasters, hazard zones and a heatmap, and the last one screened, in one go."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from qgis.core import QgsProcessingException

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance, is_point_cloud_layer_possible, load_on_completion
from . import declare, products
from .base import SlopeWatchAlgorithm
from .elevationchange import CHANGE_FILES, CHANGE_NUMBERS, CHANGE_PAGES
from .registerepochs import REGISTRATION_NUMBERS, STABLE_HELP
from .values import Values

_LABELLED = Appearance(9, visible=False, expanded=False)
_ON_REQUEST = ("DISPLACEMENT", "ONE_DIRECTION")
_MOTION_LAYERS = ("VECTORS", "MOVING_ZONES", "ONE_DIRECTION")
# the name DISPLACEMENT is that of the parameter
_MOTION = tuple(
    replace(p, name={"DISPLACEMENT": "DISPLACEMENT_RASTER"}.get(p.name, p.name), by_default=p.name not in _ON_REQUEST)
    for p in products.MOTION_PRODUCTS
)
_PRODUCTS = (*products.CHANGE_PRODUCTS, *_MOTION, *products.SCREENED_PRODUCTS)


class InspectSlope(SlopeWatchAlgorithm):
    NAME = "inspectslope"
    TITLE = "Inspect slope"
    GROUP = "inspection"
    SUMMARY = (
        "Takes two raw surveys of a slope to elevation change, hazard zones with volumes, motion along the surface, a "
        "heatmap, and a screening of the last one."
    )
    TAGS = (
        "change detection", "DEM of difference", "DoD", "deformation", "hazard", "zones", "monitoring", "landslide",
        "rockfall", "erosion", "settlement", "subsidence", "uplift", "heave", "cut and fill", "cut fill", "volume",
        "earthworks", "whole workflow", "compare two surveys", "displacement", "sliding",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.INSPECT
    BASIC = BASIC["inspect"]
    OPTION_NAMES: ClassVar = {"epoch": "REFERENCE"}
    NUMBERS: ClassVar = {
        **CHANGE_NUMBERS,
        **REGISTRATION_NUMBERS,
        "MOVING_ZONE_COUNT": ("moving_zone_count", "Zones that move along the surface"),
        "FASTEST_ZONE": ("fastest_zone_m", "Largest motion of a zone along the surface (m)"),
        "SCREENED_ZONE_COUNT": ("screened_zone_count", "Number of screened zones"),
        "CONFIRMED_ZONES": ("confirmed_zones", "Screened zones that the change confirms"),
    }
    PAGES = CHANGE_PAGES
    FILES: ClassVar = {
        **CHANGE_FILES,
        "TRANSFORM_FILE": ("transform", "Transform"),
        "REFERENCE_GROUND": ("reference_ground", "Ground of the first survey"),
        "REGISTERED_GROUND": ("aligned", "Ground of the later survey, registered"),
        "SCREENED_CLOUD": ("screened", "Ground of the last survey, labelled"),
        "SCREENED_MAP": ("screened_map", "Map of the screening"),
    }

    def inputs(self) -> None:
        self.add(
            *declare.survey_parameters(
                "First survey",
                "Raw point cloud of the {} survey, LAS or LAZ.",
                " Not set: the first survey is screened, and no change is reported.",
            ),
            declare.roi_parameter("the whole clouds"),
            declare.profile_parameter(self.PARAMETER_GROUPS),
        )
        self.declare_groups()
        self.add(
            declare.polygon_parameter(
                "STABLE", "Registration: stable ground", STABLE_HELP, advanced=True, title="Registration"
            ),
            declare.profiles_parameter(advanced=True),
            declare.corrections_parameter(),
            *declare.road_parameters(),
            declare.classes_parameter(),
        )
        products.declare_folder(self, products.CHANGE_FOLDER)
        products.declare_products(self, _PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        epochs: list[str] = []
        self._days = []
        for name in ("REFERENCE", "CLOUD"):
            path = values.file(name)
            if not path:
                continue
            day = values.survey_date(f"{name}_DATE", path)
            if not day:
                raise QgsProcessingException(
                    f"{name}_DATE is not set and the name of {path} holds no day; give the day of the survey."
                )
            self._days.append(day)
            epochs += ["--epoch", f"{day}={path}"]
        options = values.options("ROI", "STABLE", "PROFILES", "CORRECTIONS", *declare.LAYERS)
        return ["inspect", *epochs, *options, "--output-dir", values.output_folder()]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        group = f"SlopeWatch {' to '.join(self._days)}"
        shown: tuple[products.Product, ...] = _PRODUCTS
        if len(self._days) == 1:
            shown = tuple(replace(p, appearance=replace(p.appearance, visible=bool(p.layer))) for p in shown)
        unmoved = () if result.metrics.get("significant_vectors") else _MOTION_LAYERS
        delivered = products.deliver(shown, result, values, group, unmoved)
        labelled = result.outputs.get("screened", "")
        if labelled and is_point_cloud_layer_possible() and values.context.layersToLoadOnCompletion():
            load_on_completion(values.context, labelled, _LABELLED, "Ground of the last survey, labelled", group)
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}
