"""Inspect a corridor: all slopes of a manifest, each in a process of its own, and what they show together."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingException

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

_MANIFEST_FILTER = "Manifests (*.csv *.gpkg *.geojson *.shp);;All files (*)"
_POLYGONS_FILTER = "Polygons (*.gpkg *.geojson *.shp *.kml);;All files (*)"
_LINES_FILTER = "Lines (*.gpkg *.geojson *.shp *.kml);;All files (*)"
_PRODUCTS = (
    products.Product(
        "ZONES",
        "corridor",
        "Zones of all slopes",
        "Polygons of the zones of all slopes with slope, chainage, kind, severity or alert level, heights and volumes.",
        Appearance(60),
        layer="zones",
    ),
    products.Product(
        "ALERTS",
        "corridor",
        "Alerts",
        "Events raised by zones, with their reason; acknowledge and close them in the fields state and state_reason.",
        Appearance(65),
        layer="alerts",
    ),
    products.Product(
        "SLOPES",
        "corridor",
        "Slopes",
        "Regions of the slopes in the order in which they should be looked at, and why some could not be computed.",
        Appearance(50, visible=False),
        layer="slopes",
    ),
)


class CorridorBatch(SlopeWatchAlgorithm):
    NAME = "corridorbatch"
    TITLE = "Inspect corridor"
    GROUP = "inspection"
    SUMMARY = "Works on all slopes of a manifest and ranks them; a stopped run goes on where it was."
    TAGS = (
        "batch", "corridor", "many slopes", "manifest", "network", "road", "alert", "chainage", "Dask", "cluster",
        "VPC", "change detection",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.BATCH
    BASIC = BASIC["batch"]
    OPTION_NAMES: ClassVar = {"alerts": "ALERT_TABLE"}
    NUMBERS: ClassVar = {
        "SLOPE_COUNT": ("slopes", "Number of slopes"),
        "SLOPES_DONE": ("slopes_done", "Slopes with results"),
        "SLOPES_COMPUTED": ("slopes_computed", "Slopes computed by this run"),
        "SLOPES_FAILED": ("slopes_failed", "Slopes that failed"),
        "ZONE_COUNT": ("zones", "Number of zones"),
        "OPEN_ALERTS": ("open_alerts", "Open alerts"),
        "HIGHEST_ATTENTION": ("highest_attention", "Highest attention"),
    }
    PAGES: ClassVar = {"PAGE": ("page", "Slopes in order")}
    FILES: ClassVar = {
        "PAGE_PDF": ("page_pdf", "Report to sign (PDF)"),
        "CORRIDOR": ("corridor", "Zones, alerts and slopes (GeoPackage)"),
        "PARQUET": ("parquet", "Zones (GeoParquet)"),
        "MOSAIC": ("mosaic", "Elevation change of all slopes (VRT)"),
        "CLOUDS": ("clouds", "Clouds that were made (virtual point cloud)"),
        "RUN_RECORD": ("run", "Run record"),
    }

    def inputs(self) -> None:
        self.add(
            declare.file_parameter(
                "MANIFEST",
                "Manifest",
                "CSV file with the columns slope, date (YYYY-MM-DD), file and roi, one line per survey, or a layer of "
                "polygons with slope, date and file.",
                _MANIFEST_FILTER,
            ),
            declare.folder_parameter(
                "INPUT",
                "Or folder of the slopes",
                "Holds one folder per slope with its LAS or LAZ files, each with its day in its name, and roi.gpkg.",
                optional=True,
            ),
            declare.file_parameter(
                "CENTRELINE",
                "Centreline",
                "Lines of the road's axis, along which zones and regions are placed. A slope may have its own in the "
                "manifest.",
                _LINES_FILTER,
            ),
            declare.file_parameter(
                "ALERT_TABLE",
                "Alert table",
                "Thresholds of the alert levels of all series. Not set: those that come with SlopeWatch.",
                declare.CSV_FILTER,
            ),
            declare.profile_parameter(self.PARAMETER_GROUPS),
        )
        self.declare_groups()
        self.add(
            declare.corrections_parameter(),
            declare.field_names_parameter(),
            declare.in_group(
                declare.file_parameter(
                    "CLASSES",
                    "Assets: classes",
                    "Polygons of classes of asset, by which the change of each slope is summed up. A slope may have "
                    "its own in the manifest.",
                    _POLYGONS_FILTER,
                    advanced=True,
                ),
                "Assets",
            ),
        )
        products.declare_folder(
            self, "Receives the results of all slopes. A folder of an earlier run goes on with what is new or missing."
        )
        products.declare_products(self, _PRODUCTS)

    def arguments(self, values: Values) -> list[str]:
        sources = [values.file(name) for name in ("MANIFEST", "INPUT")]
        if all(sources) or not any(sources):
            raise QgsProcessingException("Give either MANIFEST or INPUT, the folder of the slopes, not both.")
        alerts = values.file("ALERT_TABLE")
        options = [*values.options("CORRECTIONS", *declare.LAYERS), *(["--alerts", alerts] if alerts else [])]
        return ["batch", next(s for s in sources if s), *options, "--output-dir", values.output_folder()]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        delivered = products.deliver(_PRODUCTS, result, values, "SlopeWatch corridor")
        return {"OUTPUT_FOLDER": values.output_folder(), **delivered}
