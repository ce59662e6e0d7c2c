"""The base of the algorithms: identity, running the engine, results. A subclass says what is its own."""

from __future__ import annotations

import os
import shlex
import subprocess
from abc import ABCMeta, abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingOutputDefinition,
    QgsProcessingOutputFile,
    QgsProcessingOutputHtml,
    QgsProcessingOutputNumber,
    QgsProcessingParameterDefinition,
)
from qgis.PyQt.QtGui import QIcon

from ..plugin.bridge import resources
from ..plugin.bridge.engine_client import EngineError, EngineResult, run_engine
from ..plugin.bridge.words import tr
from . import declare
from .dialog_words import DialogFeedback, in_dialog_words, with_labels
from .values import Values, problem, worded

GROUPS = {"inspection": "Inspection", "steps": "Single steps", "tools": "Tools"}


class _AlgorithmMeta(type(QgsProcessingAlgorithm), ABCMeta):  # type: ignore[misc]
    """QGIS's metaclass, with abstract methods."""


class SlopeWatchAlgorithm(QgsProcessingAlgorithm, metaclass=_AlgorithmMeta):
    """One command of the engine as a Processing algorithm."""

    NAME = ""
    TITLE = ""
    GROUP = ""
    SUMMARY = ""
    TAGS: tuple[str, ...] = ()
    PARAMETER_GROUPS: declare.Groups = ()
    #: names of those parameters of PARAMETER_GROUPS that are not advanced; None: as the parameters themselves say
    BASIC: tuple[str, ...] | None = None
    #: options of the engine's command whose parameter here has another name than the option
    OPTION_NAMES: ClassVar[dict[str, str]] = {}
    #: name of the output: (key in the engine's metrics, label)
    NUMBERS: ClassVar[dict[str, tuple[str, str]]] = {}
    #: name of the output: (key in the engine's outputs, label)
    FILES: ClassVar[dict[str, tuple[str, str]]] = {}
    #: the same for pages that QGIS shows in its results viewer
    PAGES: ClassVar[dict[str, tuple[str, str]]] = {}

    @abstractmethod
    def inputs(self) -> None:
        """Declare the parameters, and outputs in addition to those of PAGES, FILES and NUMBERS."""

    @abstractmethod
    def arguments(self, values: Values) -> list[str]:
        """The engine's command and its options, without those of PARAMETER_GROUPS."""

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        """Outputs in addition to those of PAGES, FILES and NUMBERS."""
        return {}

    # --- identity -----------------------------------------------------------------------------------------------

    def createInstance(self) -> SlopeWatchAlgorithm:
        return type(self)()

    def name(self) -> str:
        return self.NAME

    def displayName(self) -> str:
        return tr(self.TITLE)

    def group(self) -> str:
        return tr(GROUPS[self.GROUP])

    def groupId(self) -> str:
        return self.GROUP

    def shortDescription(self) -> str:
        return tr(self.SUMMARY)

    def shortHelpString(self) -> str:
        return resources.help_text(self.NAME)

    def helpUrl(self) -> str:
        return resources.help_url("index") + f"#{self.NAME}"

    def tags(self) -> list[str]:
        # the title as well: who reads another language may know the English one
        return [*self.TAGS, "lidar", "uav", "drone", "slope", "point clouds", self.TITLE]

    def icon(self) -> QIcon:
        return resources.icon(self.NAME)

    def svgIconPath(self) -> str:
        return resources.icon_path(self.NAME)

    # --- declaration --------------------------------------------------------------------------------------------

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.inputs()
        for name, (_, label) in self.PAGES.items():
            self.addOutput(QgsProcessingOutputHtml(name, label))
        for name, (_, label) in self.FILES.items():
            self.addOutput(QgsProcessingOutputFile(name, label))
        for name, (_, label) in self.NUMBERS.items():
            self.addOutput(QgsProcessingOutputNumber(name, label))

    def addParameter(self, definition: QgsProcessingParameterDefinition, createOutput: bool = True) -> bool:
        """Declare a parameter, its label and help in the language of QGIS."""
        definition.setDescription(tr(definition.description()))
        definition.setHelp(tr(definition.help()))
        return bool(super().addParameter(definition, createOutput))

    def addOutput(self, definition: QgsProcessingOutputDefinition) -> bool:
        """Declare an output, its label in the language of QGIS."""
        definition.setDescription(tr(definition.description()))
        return bool(super().addOutput(definition))

    def add(self, *parameters: QgsProcessingParameterDefinition) -> None:
        for parameter in parameters:
            self.addParameter(parameter)

    def declare_groups(self) -> None:
        """Declare every parameter of PARAMETER_GROUPS, and the file that gives their values back.

        At most ten parameters of a dialog are not advanced, its files and layers included.
        """
        self.addParameter(declare.settings_parameter())
        several = len({group.title for group in self.PARAMETER_GROUPS}) > 1
        for group in self.PARAMETER_GROUPS:
            for specification in group.specifications():
                advanced = specification.advanced if self.BASIC is None else specification.name not in self.BASIC
                title = group.title if several and advanced else ""
                self.addParameter(declare.from_specification(specification, title=title, advanced=advanced))

    # --- running ------------------------------------------------------------------------------------------------

    def checkParameterValues(self, parameters: dict[str, Any], context: QgsProcessingContext) -> tuple[bool, str]:
        sentence = problem(self.PARAMETER_GROUPS, parameters)
        if sentence:
            return False, in_dialog_words(self, self.PARAMETER_GROUPS, tr(sentence))
        return super().checkParameterValues(worded(self, parameters), context)

    def prepareAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> bool:
        # In QGIS's main thread, because layers may have to be exported.
        self._values = Values(self, parameters, context, feedback)
        try:
            self._arguments = self.command(self._values)
        except QgsProcessingException as error:
            sentence = in_dialog_words(self, self.PARAMETER_GROUPS, tr(str(error)))
            raise QgsProcessingException(with_labels(self, sentence)) from None
        return True

    def command(self, values: Values) -> list[str]:
        """The engine's command with all options."""
        return [*self.arguments(values), *values.settings(self.PARAMETER_GROUPS)]

    def processAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        feedback.pushCommandInfo(shown(["slopewatch", *self._arguments]))
        try:
            result = run_engine(self._arguments, DialogFeedback(feedback, self, self.PARAMETER_GROUPS))
        except EngineError as error:
            raise QgsProcessingException(in_dialog_words(self, self.PARAMETER_GROUPS, tr(str(error)))) from None
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
            # a thread of a task has a context of its own
            results.update(self.results(result, replace(self._values, context=context, feedback=feedback)))
        except OSError as error:
            raise QgsProcessingException(tr(f"An output cannot be written: {error}.")) from None
        for sentence in result.conclusion:
            feedback.pushInfo(in_dialog_words(self, self.PARAMETER_GROUPS, sentence))
        return results


def shown(command: list[str]) -> str:
    """The command as one would type it."""
    return subprocess.list2cmdline(command) if os.name == "nt" else shlex.join(command)
