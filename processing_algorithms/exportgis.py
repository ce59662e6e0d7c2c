"""Export to GIS and CAD: the results of a finished run as files of other systems."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from qgis.core import (
    QgsProcessingException,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterString,
)

from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from . import declare
from .base import SlopeWatchAlgorithm
from .values import Values

_NAMES_FILTER = "Names of fields (*.csv *.json);;All files (*)"
_RUN = "Output folder of a finished inspection, series, screening, corridor, flight plan or single step."
_ARCHIVE = "Archive of all files with their checksums. A name that does not end in .zip is a folder. May be skipped."
_DATABASE = (
    "PostgreSQL with PostGIS that zones, events and their history are added to: postgresql://user@host/database. "
    "Without password, which belongs into ~/.pgpass or PGPASSWORD. Not set: no database."
)
_PASSWORD = re.compile(r"//[^/?@]*:[^/?@]*@|[?&](ssl)?password=", re.IGNORECASE)


class ExportGis(SlopeWatchAlgorithm):
    NAME = "exportgis"
    TITLE = "Export to GIS and CAD"
    GROUP = "tools"
    SUMMARY = "Hands the results of a run over to other systems: rasters, layers, drawings, metadata, checksums."
    TAGS = (
        "export", "hand over", "handover", "deliver", "cog", "geotiff", "gpkg", "geopackage", "geojson", "kml", "csv",
        "dxf", "autocad", "cad", "landxml", "civil 3d", "tin", "sld", "qml", "iso 19115", "iso 19139", "metadata",
        "stac", "copc", "zip", "sha256", "checksum", "asset management", "field names",
        "postgis", "postgresql", "database", "gdms",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.EXPORTGIS
    NUMBERS: ClassVar = {
        "FILES": ("files", "Files handed over"),
        "LAYERS": ("layers", "Layers among them"),
        "DATABASE_ZONES": ("database_zones", "Zones handed over to the database"),
        "DATABASE_EVENTS": ("database_events", "Events handed over to the database"),
    }
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def inputs(self) -> None:
        self.add(
            declare.folder_parameter("INPUT", "Folder of results", _RUN),
            declare.file_parameter(
                "FIELDS",
                "Names of fields",
                "Names that were agreed on: a CSV of the columns ours,theirs, or a JSON object. Not set: SlopeWatch's.",
                _NAMES_FILTER,
            ),
        )
        self.add(
            declare.with_help(QgsProcessingParameterString("TO", "Database", optional=True), _DATABASE),
        )
        self.declare_groups()
        destination = QgsProcessingParameterFileDestination(
            "OUTPUT", "Archive", "ZIP archives (*.zip *.ZIP)", optional=True, createByDefault=True
        )
        self.add(declare.with_help(destination, _ARCHIVE))

    def arguments(self, values: Values) -> list[str]:
        run = values.file("INPUT")
        if not run:
            raise QgsProcessingException("INPUT is empty; give the output folder of a finished run.")
        address = self.parameterAsString(values.parameters, "TO", values.context).strip()
        if _PASSWORD.search(address):  # QGIS keeps what was given in its log and history
            raise QgsProcessingException(
                "TO holds a password, which QGIS would keep in its history; leave it out and put it into ~/.pgpass."
            )
        to = ["--to", address] if address else []
        return ["exportgis", run, *values.options("OUTPUT", "FIELDS"), *to]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        return {"OUTPUT": values.output_file("OUTPUT")}
