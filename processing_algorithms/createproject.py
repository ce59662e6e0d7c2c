"""Create project: a finished run as a QGIS project with groups, times and a print layout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qgis.core import (
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingOutputNumber,
    QgsProcessingOutputString,
    QgsProcessingParameterFileDestination,
)

from ..interface.parameters import command_sets
from ..plugin.bridge import resources
from ..plugin.bridge.compat import NO_THREADING
from ..plugin.bridge.print_layout import Sheet
from ..plugin.bridge.project_contents import Contents, NoRunError, read_contents
from ..plugin.bridge.project_file import ProjectError, write_project
from ..plugin.bridge.words import tr
from . import declare
from .base import SlopeWatchAlgorithm
from .values import Values

_ENDINGS = (".qgz", ".qgs")


class CreateProject(SlopeWatchAlgorithm):
    NAME = "createproject"
    TITLE = "Create project"
    GROUP = "tools"
    SUMMARY = "Makes a QGIS project of the results of a run: groups, styles, times of the surveys, a print layout."
    TAGS = (
        "project", "qgz", "qgs", "print layout", "layout", "map sheet", "pdf", "legend", "temporal", "groups",
        "relative paths", "hand over",
    )  # fmt: skip

    def inputs(self) -> None:
        self.add(
            declare.folder_parameter(
                "INPUT", "Folder of results", "Output folder of a finished inspection, series, corridor or single step."
            ),
        )
        for group in command_sets.CREATEPROJECT:
            self.add(*(declare.from_specification(one) for one in group.specifications()))
        output = QgsProcessingParameterFileDestination("OUTPUT", "Project", "QGIS projects (*.qgz *.qgs)")
        self.add(
            declare.with_help(
                output,
                "The project file (.qgz). It names its layers from its own folder: next to the results, both can be "
                "moved together.",
            )
        )
        self.addOutput(QgsProcessingOutputNumber("LAYERS", "Layers of the project"))
        self.addOutput(QgsProcessingOutputString("LAYOUT", "Name of the print layout"))

    def flags(self) -> Any:
        # layers and layouts are made in QGIS's main thread
        return super().flags() | NO_THREADING

    def arguments(self, values: Values) -> list[str]:
        return []  # it runs no command of the engine

    def prepareAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> bool:
        values = Values(self, parameters, context, feedback)
        run, output = values.file("INPUT"), values.output_file("OUTPUT")
        if not run:
            raise QgsProcessingException(tr("INPUT is empty; give the output folder of a finished run."))
        if Path(output).suffix.lower() not in _ENDINGS:
            raise QgsProcessingException(tr(f"The output {output} is to be a project; end its name in .qgz."))
        if not Path(output).parent.is_dir():
            raise QgsProcessingException(tr(f"The folder {Path(output).parent} does not exist; create it first."))
        if Path(output).exists() and not self.parameterAsBool(parameters, "OVERWRITE", context):
            sentence = f"{output} is there already; choose another name, or overwrite it."
            raise QgsProcessingException(tr(sentence))
        try:
            self._contents = read_contents(run)
        except NoRunError as error:
            raise QgsProcessingException(tr(str(error))) from None
        self._output = Path(output)
        title, author = (
            self.parameterAsString(parameters, name, context).strip() for name in ("PROJECT_TITLE", "AUTHOR")
        )
        self._sheet = _sheet(self._contents, title, author, values._choice("PAPER"))
        return True

    def processAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        if self._contents.folder not in (self._output.absolute().parent, *self._output.absolute().parents):
            feedback.pushInfo(
                tr("The project does not lie in the folder of the results; move both together, as they lie now.")
            )
        try:
            made = write_project(self._contents, self._output, self._sheet)
        except ProjectError as error:
            raise QgsProcessingException(tr(str(error))) from None
        feedback.pushInfo(tr(f"The project has {made.layers} layers and the print layout {made.layout}."))
        return {"OUTPUT": str(self._output), "LAYERS": made.layers, "LAYOUT": made.layout}


def _sheet(contents: Contents, title: str, author: str, paper: str) -> Sheet:
    span = (
        tr("{0} to {1}").format(contents.days[0], contents.days[-1])
        if len(contents.days) > 1
        else "".join(contents.days)
    )
    named = f"{contents.title}, {span}" if span else contents.title
    shown = tr("No change above the level of detection is no statement that nothing moved.")
    return Sheet(
        title or named, f"{named}\n{shown}" if title else shown, author, f"SlopeWatch {resources.version()}", paper
    )
