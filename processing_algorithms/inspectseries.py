"""Inspect series: two or more surveys of one slope to velocities, zones through time and alert levels."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import (
    QgsProcessingException,
    QgsProcessingOutputMultipleLayers,
    QgsProcessingParameterBoolean,
)

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.project_time import project_time
from ..plugin.bridge.styling import Appearance, load_on_completion
from . import declare, products
from .base import SlopeWatchAlgorithm
from .registerepochs import STABLE_HELP
from .values import Values

_PRODUCTS = (
    products.Product(
        "ZONES",
        "series_zones",
        "Zones and alert levels",
        "Polygons that moved, followed through the surveys, with velocity, trend, volume and alert level.",
        Appearance(60),
        layer="zones",
        file="series.gpkg",
    ),
    products.Product(
        "SERIES",
        "series_zones",
        "Zones survey by survey",
        "The same polygons once for each survey with their change until then, for the temporal controller.",
        Appearance(55, visible=False, expanded=False),
        layer="series",
        file="series.gpkg",
    ),
    products.Product(
        "VELOCITY",
        "velocity",
        "Velocity (mm/day)",
        "Velocity of each cell by regression over all surveys.",
        Appearance(30, visible=False, expanded=False),
    ),
    products.Product(
        "VELOCITY_ERROR",
        "velocity_error",
        "Standard error of the velocity (mm/day)",
        "Of each cell, from the errors of all surveys and their scatter about the line.",
        Appearance(20, visible=False, expanded=False),
        by_default=False,
    ),
    products.Product(
        "EPOCHS_CONFIRMED",
        "epochs_confirmed",
        "Comparisons that confirm",
        "How many comparisons with the first survey in a row show change of one sign beyond the level of detection.",
        Appearance(25, visible=False, expanded=False),
        by_default=False,
    ),
    products.CLASSES,
    products.Product(
        "MOTION_VECTORS",
        "displacement_vectors",
        "Motion along the surface, survey by survey",
        "Arrows of the motion against the first survey, drawn longer than they are, with the ellipse of their error; "
        "one for each survey, for the temporal controller. Only where motion along the surface was measured.",
        Appearance(64, visible=False, expanded=False),
        layer="vectors",
        file="displacement.gpkg",
    ),
    products.Product(
        "MOTION_STEPS",
        "displacement_vectors",
        "Motion along the surface since the survey before",
        "The same from each survey to the next.",
        Appearance(63, visible=False, expanded=False),
        layer="steps",
        by_default=False,
        file="displacement.gpkg",
    ),
    products.Product(
        "MOTION_VELOCITIES",
        "displacement_vectors",
        "Velocity vectors along the surface",
        "Arrows of significant velocity by regression over all surveys, with the ellipse of their error.",
        Appearance(65),
        layer="velocities",
        file="displacement.gpkg",
    ),
    products.Product(
        "MOVING_ZONES",
        "displacement_vectors",
        "Zones of coherent motion, survey by survey",
        "Polygons of ground that moves as one, with its motion until each survey, its velocity and their errors.",
        Appearance(66, visible=False, expanded=False),
        layer="zones",
        by_default=False,
        file="displacement.gpkg",
    ),
    products.Product(
        "MOTION",
        "displacement",
        "Motion along the surface (m)",
        "Motion of the last survey against the first with its standard errors, and the reason where none can be given.",
        Appearance(28, visible=False, expanded=False),
        by_default=False,
    ),
    products.Product(
        "SMALLEST_MOTION",
        "smallest_motion",
        "Smallest motion that can be told (m)",
        "Three standard errors of that motion, also where nothing moved.",
        Appearance(27, visible=False, expanded=False),
        by_default=False,
    ),
)
_KINDS = (
    ("CUMULATIVE", "cumulative", "Change since the first survey", 45),
    ("INCREMENTAL", "incremental", "Change since the survey before", 40),
)


class InspectSeries(SlopeWatchAlgorithm):
    NAME = "inspectseries"
    TITLE = "Inspect series"
    GROUP = "inspection"
    SUMMARY = "Takes two or more surveys of a slope to velocities, zones followed through time, and alert levels."
    TAGS = (
        "change detection", "series", "time series", "velocity", "monitoring", "creep", "landslide", "settlement",
        "subsidence", "alert", "alarm", "temporal", "inverse velocity", "trend", "early warning", "vector", "sliding",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.SERIES
    BASIC = BASIC["series"]
    NUMBERS: ClassVar = {
        "EPOCH_COUNT": ("epoch_count", "Number of surveys"),
        "ZONE_COUNT": ("zone_count", "Number of zones"),
        "CONFIRMED_ZONES": ("confirmed_zone_count", "Zones confirmed by two comparisons or more"),
        "HIGHEST_ALERT": ("highest_alert", "Highest alert level"),
        "ALERTED_ZONES": ("alerted_zone_count", "Zones with an alert level above 0"),
        "FASTEST_RATE": ("fastest_rate_mm_day", "Fastest zone (mm/day)"),
        "DETECTABLE_RATE": ("detectable_rate_mm_day", "Rate that a cell needs to be seen between two surveys (mm/day)"),
        "LEVEL_MEDIAN": ("lod_median_m", "Median level of detection, last survey against the first (m)"),
        "MOVING_ZONE_COUNT": ("moving_zone_count", "Zones that move along the surface"),
        "FASTEST_MOTION": ("fastest_motion_mm_day", "Fastest zone along the surface (mm/day)"),
    }
    PAGES: ClassVar = {"REPORT": ("report", "Report")}
    FILES: ClassVar = {
        "REPORT_PDF": ("report_pdf", "Report to sign (PDF)"),
        "TABLE": ("series_table", "Time series of the zones (CSV)"),
        "PICTURE": ("series_picture", "Picture of velocities and series"),
        "CLASS_TABLE": ("budget_by_class", "Table of the change by class"),
        "ALERTS_USED": ("alerts_used", "Alert table that was used"),
        "RUN_RECORD": ("run", "Run record"),
    }

    def inputs(self) -> None:
        self.add(
            declare.folder_parameter(
                "INPUT",
                "Folder of the surveys",
                "Holds one LAS or LAZ file per survey, each with its day in its name, such as 2024-05-01.laz.",
                optional=True,
            ),
            declare.file_parameter(
                "MANIFEST",
                "Or manifest",
                "CSV file with the columns date (YYYY-MM-DD) and path, one line per survey, instead of a folder.",
                declare.CSV_FILTER,
            ),
            declare.roi_parameter("the whole clouds"),
            declare.file_parameter(
                "ALERTS",
                "Alert table",
                "Thresholds of the alert levels. Not set: those that come with SlopeWatch, which every run writes as "
                "alerts_used.csv; edit a copy of it.",
                declare.CSV_FILTER,
            ),
            declare.profile_parameter(self.PARAMETER_GROUPS),
        )
        self.declare_groups()
        self.add(
            declare.polygon_parameter(
                "STABLE", "Registration: stable ground", STABLE_HELP, advanced=True, title="Registration"
            ),
            declare.corrections_parameter(),
            *declare.road_parameters(),
            declare.classes_parameter(),
            declare.in_group(
                declare.with_help(
                    QgsProcessingParameterBoolean("LOAD_RASTERS", "Load the rasters of every survey", True),
                    "Loads the change of every survey with the days on which the temporal controller shows it.",
                    advanced=True,
                ),
                "Output",
            ),
        )
        products.declare_folder(
            self, "Receives all results, and in work/ what the next run with one more survey does not compute again."
        )
        products.declare_products(self, _PRODUCTS)
        for name, _, label, _ in _KINDS:
            self.addOutput(QgsProcessingOutputMultipleLayers(name, f"{label} (m)"))

    def arguments(self, values: Values) -> list[str]:
        sources = [values.file(name) for name in ("INPUT", "MANIFEST")]
        if all(sources) or not any(sources):
            raise QgsProcessingException("Give either INPUT, the folder of the surveys, or MANIFEST, not both.")
        options = values.options("ROI", "STABLE", "ALERTS", "CORRECTIONS", *declare.LAYERS)
        return ["series", next(s for s in sources if s), *options, "--output-dir", values.output_folder()]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        group = "SlopeWatch series"
        delivered = products.deliver(_PRODUCTS, result, values, group)
        # asked for after that: asking for a destination as a layer would have it loaded once more
        shown = bool(values.context.layersToLoadOnCompletion()) and self.parameterAsBoolean(
            values.parameters, "LOAD_RASTERS", values.context
        )
        lists: dict[str, Any] = {}
        for name, kind, label, order in _KINDS:
            paths = [p for key, p in sorted(result.outputs.items()) if key.startswith(f"{kind}_change_")]
            lists[name] = paths
            after = project_time()
            for number, path in enumerate(paths if shown else ()):
                # the last survey alone: earlier ones would show where it has no data
                last = kind == "cumulative" and number == len(paths) - 1
                appearance = Appearance(order * 1000 + number, visible=last, expanded=last, after=after)
                name = f"{path.rpartition('.')[0][-10:]} {label[:1].lower()}{label[1:]}"
                load_on_completion(values.context, path, appearance, name, f"{group}, {label.lower()}")
        return {"OUTPUT_FOLDER": values.output_folder(), **lists, **delivered}
