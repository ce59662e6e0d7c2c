"""Write report: the report of an output folder made again, with profiles along other lines."""

from __future__ import annotations

from typing import ClassVar

from qgis.core import QgsProcessingException

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from . import declare
from .base import SlopeWatchAlgorithm
from .values import Values


class WriteReport(SlopeWatchAlgorithm):
    NAME = "writereport"
    TITLE = "Write report"
    GROUP = "steps"
    SUMMARY = (
        "Makes the report of a finished inspection, series or corridor again: with profiles along your own lines and "
        "photos of zones if you give some, and as a PDF to sign if you want one."
    )
    TAGS = (
        "report", "html", "pdf", "print", "profile", "section", "cross-section", "summary", "document", "sign",
        "signature",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.REPORT
    BASIC = BASIC["report"]
    PAGES: ClassVar = {"REPORT": ("report", "Report")}
    FILES: ClassVar = {
        "REPORT_PDF": ("report_pdf", "Report to sign (PDF)"),
        "PROFILE_LINES": ("profiles", "Lines of the profiles"),
        "PROFILE_TABLE": ("profiles_table", "Cells along the profiles (CSV)"),
    }

    def inputs(self) -> None:
        self.add(
            declare.folder_parameter(
                "INPUT",
                "Folder of results",
                "Output folder of Inspect slope, Inspect series, Inspect corridor, Elevation change, Change of "
                "elevation models, Displacement vectors or M3C2 distances. The report in it is replaced.",
            ),
            declare.profiles_parameter(),
            declare.folder_parameter(
                "PHOTOS",
                "Folder of photos",
                "Pictures whose names begin with the id of a zone, such as Z001.jpg. They are copied into the folder "
                "of results and shown with their zones. Not set: the photos that were entered before.",
                optional=True,
            ),
        )
        self.declare_groups()

    def arguments(self, values: Values) -> list[str]:
        folder = values.file("INPUT")
        if not folder:
            raise QgsProcessingException("INPUT is empty; give the output folder of a run that has a report.")
        return ["report", folder, *values.options("PROFILES", "PHOTOS")]
