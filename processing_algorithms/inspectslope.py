"""Inspect slope: two raw surveys to rasters, hazard zones and a heatmap, and the last one screened, in one go."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from qgis.core import QgsProcessingContext, QgsProcessingException, QgsProcessingFeedback

from ..interface.parameters import (
    ChangeParameters,
    DateParameters,
    GroundParameters,
    HeatmapParameters,
    InputParameters,
    LastEpochParameters,
    OutputParameters,
    RegistrationParameters,
    ReportParameters,
    ZoneParameters,
)
from ..plugin.bridge.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm
from .elevationchange import CHANGE_FILES, CHANGE_NUMBERS, CHANGE_PAGES
from .registerepochs import REGISTRATION_NUMBERS, STABLE_HELP

_BASIC = ("cloth_resolution", "cell", "adaptive", "confidence", "minimum_area", "screen_last_epoch", "overwrite")
_PREFIXES = {
    "inputs": "Input",
    "dates": "Input",
    "ground": "Ground",
    "registration": "Registration",
    "change": "Change",
    "zones": "Zones",
    "heatmap": "Heatmap",
    "report": "Report",
    "screening": "Screening",
}
_PRODUCTS = (*products.CHANGE_PRODUCTS, *products.SCREENED_PRODUCTS)
_EPOCHS = (("REFERENCE", "REFERENCE_DATE"), ("CLOUD", "CLOUD_DATE"))


class InspectSlope(SlopeWatchAlgorithm):
    NAME = "inspectslope"
    TITLE = "Inspect slope"
    GROUP = "inspection"
    SUMMARY = (
        "Takes two raw surveys of a slope to elevation change, hazard zones with volumes, a heatmap, and a screening "
        "of the last one."
    )
    TAGS = ("change", "deformation", "hazard", "zones", "monitoring", "landslide", "subsidence", "uplift", "volume")
    PARAMETER_GROUPS = (
        GroundParameters,
        RegistrationParameters,
        ChangeParameters,
        ZoneParameters,
        HeatmapParameters,
        ReportParameters,
        LastEpochParameters,
        InputParameters,
        DateParameters,
        OutputParameters,
    )
    NUMBERS: ClassVar = {
        **CHANGE_NUMBERS,
        **REGISTRATION_NUMBERS,
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

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.addParameter(
            declare.cloud_parameter("REFERENCE", "First survey", "Raw point cloud of the first survey, LAS or LAZ.")
        )
        self.addParameter(declare.date_parameter("REFERENCE_DATE", "Day of the first survey"))
        self.addParameter(
            declare.cloud_parameter(
                "CLOUD",
                "Later survey",
                "Raw point cloud of the later survey, LAS or LAZ. Not set: the first survey is screened, and no change "
                "is told.",
                optional=True,
            )
        )
        self.addParameter(declare.date_parameter("CLOUD_DATE", "Day of the later survey"))
        self.addParameter(
            declare.polygon_parameter(
                "ROI",
                "Region of interest",
                "Polygons of the slope, in any reference system. Larger takes longer; not set: the whole clouds.",
            )
        )
        self.addParameter(declare.profile_parameter())
        self.declare_groups(basic=_BASIC, prefixes=_PREFIXES)
        self.addParameter(
            declare.polygon_parameter("STABLE", "Registration: stable ground", STABLE_HELP, advanced=True)
        )
        self.addParameter(declare.profiles_parameter(advanced=True))
        products.declare_folder(
            self, "Receives the rasters, hazard zones, heatmap, report and run record under fixed names."
        )
        products.declare_products(self, _PRODUCTS)
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        self._folder = products.output_folder(self, parameters, context)
        arguments = ["inspect"]
        days: list[str] = []
        for name, day_name in _EPOCHS:
            path = self.file(parameters, name, context)
            if not path:
                continue
            day = self.survey_date(parameters, day_name, path, context)
            if not day:
                raise QgsProcessingException(
                    f"{day_name} is not set and the name of {path} tells no day; give the day of the survey."
                )
            days.append(day)
            arguments += ["--epoch", f"{day}={path}"]
        self._days = days
        arguments += self.vector_options(parameters, context, feedback, "ROI", "STABLE", "PROFILES")
        arguments += ["--output-dir", self._folder]
        arguments += declare.profile_options(self, parameters, context)
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        group = f"SlopeWatch {' to '.join(self._days)}"
        shown: tuple[products.Product, ...] = _PRODUCTS
        if len(self._days) == 1:
            shown = tuple(replace(p, appearance=replace(p.appearance, visible=bool(p.layer))) for p in shown)
        delivered = products.deliver(self, shown, result, parameters, context, group)
        return {"OUTPUT_FOLDER": self._folder, **delivered}
