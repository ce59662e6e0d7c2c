"""Write report: the report of an output folder made again, with profiles along other lines."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingContext, QgsProcessingException, QgsProcessingFeedback, QgsProcessingParameterFile

from ..interface.parameters import ReportParameters
from ..plugin.bridge.compat import FOLDER
from . import declare
from .base import SlopeWatchAlgorithm


class WriteReport(SlopeWatchAlgorithm):
    NAME = "writereport"
    TITLE = "Write report"
    GROUP = "steps"
    SUMMARY = "Makes the report of a finished inspection again, with profiles along your own lines if you give some."
    TAGS = ("report", "html", "print", "profile", "section", "cross-section", "summary")
    PARAMETER_GROUPS = (ReportParameters,)
    PAGES: ClassVar = {"REPORT": ("report", "Report")}
    FILES: ClassVar = {
        "PROFILE_LINES": ("profiles", "Lines of the profiles"),
        "PROFILE_TABLE": ("profiles_table", "Cells along the profiles (CSV)"),
    }

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.addParameter(
            declare.with_help(
                QgsProcessingParameterFile("INPUT", "Folder of results", FOLDER),
                "Output folder of Inspect slope or Elevation change. The report in it is replaced.",
            )
        )
        self.addParameter(declare.profiles_parameter())
        self.declare_groups()
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        folder = self.file(parameters, "INPUT", context)
        if not folder:
            raise QgsProcessingException("INPUT is empty; give the output folder of Inspect slope or Elevation change.")
        arguments = ["report", folder, *self.vector_options(parameters, context, feedback, "PROFILES")]
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)
