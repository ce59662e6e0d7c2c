"""The base of the algorithms: identity, running the engine, results. A subclass says what is its own."""

from __future__ import annotations

import os
import shlex
import subprocess
from pathlib import Path
from typing import Any, ClassVar

from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingOutputFile,
    QgsProcessingOutputHtml,
    QgsProcessingOutputNumber,
)
from qgis.PyQt.QtGui import QIcon

from ..interface.dates import date_in_name
from ..plugin.bridge import resources
from ..plugin.bridge.engine_client import EngineError, EngineResult, run_engine
from . import declare
from .dialog_words import DialogFeedback, in_dialog_words

GROUPS = {"inspection": "Inspection", "steps": "Single steps", "tools": "Tools"}
_VECTOR_FORMATS = ["gpkg", "shp", "geojson", "json", "kml", "gml", "fgb"]


class SlopeWatchAlgorithm(QgsProcessingAlgorithm):
    """One command of the engine as a Processing algorithm."""

    NAME = ""
    TITLE = ""
    GROUP = ""
    SUMMARY = ""
    TAGS: tuple[str, ...] = ()
    PARAMETER_GROUPS: declare.Groups = ()
    #: name of the output: (key in the engine's metrics, label)
    NUMBERS: ClassVar[dict[str, tuple[str, str]]] = {}
    #: name of the output: (key in the engine's outputs, label)
    FILES: ClassVar[dict[str, tuple[str, str]]] = {}
    #: the same for pages that QGIS shows in its results viewer
    PAGES: ClassVar[dict[str, tuple[str, str]]] = {}

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        """The engine's command and options."""
        raise NotImplementedError

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        """Outputs in addition to those of PAGES, FILES and NUMBERS."""
        return {}

    # --- identity -----------------------------------------------------------------------------------------------

    def createInstance(self) -> SlopeWatchAlgorithm:
        return type(self)()

    def name(self) -> str:
        return self.NAME

    def displayName(self) -> str:
        return self.TITLE

    def group(self) -> str:
        return GROUPS[self.GROUP]

    def groupId(self) -> str:
        return self.GROUP

    def shortDescription(self) -> str:
        return self.SUMMARY

    def shortHelpString(self) -> str:
        return resources.help_text(self.NAME)

    def helpUrl(self) -> str:
        return resources.help_url("index") + f"#{self.NAME}"

    def tags(self) -> list[str]:
        return [*self.TAGS, "lidar", "uav", "slope", "point cloud"]

    def icon(self) -> QIcon:
        return resources.icon(self.NAME)

    def svgIconPath(self) -> str:
        return resources.icon_path(self.NAME)

    # --- declaration --------------------------------------------------------------------------------------------

    def declare_groups(self, *, basic: tuple[str, ...] | None = None, prefixes: dict[str, str] | None = None) -> None:
        """Declare every parameter of PARAMETER_GROUPS; with ``basic`` all others than those named are advanced."""
        for group in self.PARAMETER_GROUPS:
            for specification in group.specifications():
                advanced = None if basic is None else specification.name not in basic
                prefix = (prefixes or {}).get(group.record_name, "") if advanced else ""
                self.addParameter(declare.from_specification(specification, prefix=prefix, advanced=advanced))

    def declare_outputs(self) -> None:
        """Declare PAGES, FILES and NUMBERS."""
        for name, (_, label) in self.PAGES.items():
            self.addOutput(QgsProcessingOutputHtml(name, label))
        for name, (_, label) in self.FILES.items():
            self.addOutput(QgsProcessingOutputFile(name, label))
        for name, (_, label) in self.NUMBERS.items():
            self.addOutput(QgsProcessingOutputNumber(name, label))

    # --- running ------------------------------------------------------------------------------------------------

    def checkParameterValues(self, parameters: dict[str, Any], context: QgsProcessingContext) -> tuple[bool, str]:
        sentence = declare.problem(self, self.PARAMETER_GROUPS, parameters, context)
        if sentence:
            return False, in_dialog_words(self, self.PARAMETER_GROUPS, sentence)
        return super().checkParameterValues(declare.worded(self, parameters), context)

    def prepareAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> bool:
        # In QGIS's main thread, because layers may have to be exported.
        self._arguments = self.arguments(parameters, context, feedback)
        return True

    def processAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        feedback.pushCommandInfo(shown(["slopewatch", *self._arguments]))
        try:
            result = run_engine(self._arguments, DialogFeedback(feedback, self, self.PARAMETER_GROUPS))
        except EngineError as error:
            raise QgsProcessingException(in_dialog_words(self, self.PARAMETER_GROUPS, str(error))) from None
        results: dict[str, Any] = {
            name: result.outputs[key]
            for name, (key, _) in (*self.PAGES.items(), *self.FILES.items())
            if key in result.outputs
        }
        for name, (key, _) in self.NUMBERS.items():
            value = result.metrics.get(key)
            if isinstance(value, (int, float)):
                results[name] = float(f"{value:.6g}") if isinstance(value, float) else value
        try:
            results.update(self.results(result, parameters, context))
        except OSError as error:
            raise QgsProcessingException(f"An output cannot be written: {error}.") from None
        return results

    # --- reading parameters -------------------------------------------------------------------------------------

    def file(self, parameters: dict[str, Any], name: str, context: QgsProcessingContext) -> str:
        """Absolute path of an input file; empty if it is not given."""
        path = self.parameterAsFile(parameters, name, context)
        return os.path.abspath(path) if path else ""

    def output_file(self, parameters: dict[str, Any], name: str, context: QgsProcessingContext) -> str:
        """Absolute path of a file or folder to write; empty if it is skipped."""
        path = self.parameterAsOutputLayer(parameters, name, context) if self._is_layer(name) else ""
        path = path or self.parameterAsFileOutput(parameters, name, context)
        return os.path.abspath(path) if path else ""

    def _is_layer(self, name: str) -> bool:
        return self.parameterDefinition(name).type() == "pointCloudDestination"

    def polygons(
        self, parameters: dict[str, Any], name: str, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> str:
        """Path of a file with polygons or lines; a selection, a filter or a layer in memory is exported first."""
        if parameters.get(name) in (None, ""):
            return ""
        path = self.parameterAsCompatibleSourceLayerPath(parameters, name, context, _VECTOR_FORMATS, "gpkg", feedback)
        if not path:
            raise QgsProcessingException(self.invalidSourceError(parameters, name))
        return os.path.abspath(path)

    def vector_options(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback, *names: str
    ) -> list[str]:
        """Options for those of the vector parameters that are given; the engine calls each as the dialog does."""
        given = [(name, self.polygons(parameters, name, context, feedback)) for name in names]
        return [part for name, path in given if path for part in (f"--{name.lower()}", path)]

    def pair_days(self, parameters: dict[str, Any], context: QgsProcessingContext) -> list[str]:
        """Days of the surveys REFERENCE and CLOUD, empty where unknown."""
        return [
            self.survey_date(parameters, f"{name}_DATE", self.file(parameters, name, context), context)
            for name in ("REFERENCE", "CLOUD")
        ]

    def pair_options(self, parameters: dict[str, Any], context: QgsProcessingContext) -> list[str]:
        """Options for those of the two days that are known."""
        days = zip(("--epoch-from", "--epoch-to"), self.pair_days(parameters, context))
        return [part for option, day in days if day for part in (option, day)]

    def survey_date(self, parameters: dict[str, Any], name: str, path: str, context: QgsProcessingContext) -> str:
        """Day of a survey as YYYY-MM-DD: the parameter ``name``, else from the file's name; empty if unknown."""
        given = self.parameterAsDateTime(parameters, name, context)
        if given.isValid():
            return str(given.date().toString("yyyy-MM-dd"))
        if parameters.get(name):
            raise QgsProcessingException(f"{name} is {parameters[name]!r}; give a day such as 2024-05-01.")
        day = date_in_name(Path(path))
        return day.isoformat() if day else ""


def shown(command: list[str]) -> str:
    """The command as one would type it."""
    return subprocess.list2cmdline(command) if os.name == "nt" else shlex.join(command)
