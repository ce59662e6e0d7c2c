"""The engine's sentences in the words of a dialog: what it calls --crs is the parameter's name there."""

from __future__ import annotations

import re
from typing import Any

from qgis.core import QgsProcessingAlgorithm, QgsProcessingParameterDefinition

from ..interface import parameters
from ..interface.command_list import TITLES
from ..interface.parameters import AUTO, ParameterSet, Specification
from ..plugin.bridge.words import tr
from .declare import Groups, specifications

# Options of every command that no dialog has.
_ELSEWHERE = {
    "pdal": "“PDAL program” under Settings > Options > SlopeWatch",
    "temporary-folder": "environment variable SLOPEWATCH_TMP",
}
# Options whose parameter has another name, in all dialogs that have it; a dialog may add its own (OPTION_NAMES).
_OTHER_NAMES = {"output-dir": "OUTPUT_FOLDER", "epoch-from": "REFERENCE_DATE", "epoch-to": "CLOUD_DATE"}
# Words are of Latin letters alone: in a Chinese sentence a name has no blank before it.
# An option, alone or with its value; not within a path or another word.
_OPTION = re.compile(r"(?<![\w/\\.-])--([a-z][a-z0-9-]*)(?: (EPSG:[A-Za-z0-9+]+|[A-Za-z0-9_]+))?(?![\w/\\])", re.ASCII)
# A parameter as Python calls it: a name with an underscore, or one that begins the sentence.
_NAME = re.compile(
    r"(?<![\w/\\.-])[a-z][a-z0-9]*(?:_[a-z0-9]+)+(?![\w/\\-]|\.\w)|^[a-z][a-z0-9]*(?= is )"
    r"|(?:(?<=\.json )|(?<=\.toml ))[a-z]+(?= is )",
    re.ASCII,
)
# A parameter as Processing calls it.
_PROCESSING_NAME = re.compile(r"(?<![\w/\\.-])[A-Z][A-Z0-9]+(?:_[A-Z0-9]+)*(?![\w/\\.-])", re.ASCII)
# A command as it is typed.
_COMMAND = re.compile(r"(?<![\w/\\.-])slopewatch ((?:simulate )?[a-z0-9]+)\b", re.ASCII)

# What a number is given for AUTO, at the end of a parameter's bounds.
_AUTO = re.compile(rf"(?:, or |，或){AUTO}(?=[.;。；]|$)")
# What only a terminal has.
_DEBUG = "; run again with --debug for details"


def in_dialog_words(algorithm: QgsProcessingAlgorithm, groups: Groups, sentence: str) -> str:
    """``sentence`` with command-line options and the engine's names of parameters replaced by the dialog's names.

    ``--crs`` becomes “Coordinate reference system”, and ``--ground extract`` becomes extract in “Ground points”. An
    option that this dialog does not have gets its label of the dialogs that have it, and a command the title of its
    tool; what no dialog has stays as it is.
    """
    names = {s.name for s in specifications(groups)}

    def option(found: re.Match[str]) -> str:
        name, value = found[1], found[2]
        definition, off = _definition(algorithm, name), ""
        if definition is None and name.startswith("no-"):
            definition, off, name = _definition(algorithm, name[3:]), tr(" off"), name[3:]
        label = _quoted(definition) or tr(_ELSEWHERE.get(name, "")) or _label_elsewhere(name)
        if not label:
            return found[0]
        if not value:
            return label + off
        in_list = definition is not None and not off and _is_value(definition, value)
        return tr("{0} in {1}").format(value, label) if in_list else f"{label}{off} {value}"

    def parameter(found: re.Match[str]) -> str:
        definition = _definition(algorithm, found[0]) if found[0] in names else None
        return _quoted(definition) or found[0]

    for debug in dict.fromkeys((_DEBUG, tr(_DEBUG))):
        sentence = sentence.replace(debug, tr("; please report it"))
    words = _OPTION.sub(option, sentence)
    words = _COMMAND.sub(lambda found: f"“{tr(TITLES[found[1]])}”" if found[1] in TITLES else found[0], words)
    return _AUTO.sub(tr(", or leave it empty"), _NAME.sub(parameter, words))


def with_labels(algorithm: QgsProcessingAlgorithm, sentence: str) -> str:
    """``sentence`` with Processing's names of the algorithm's parameters replaced by their labels."""
    return _PROCESSING_NAME.sub(lambda found: _quoted(algorithm.parameterDefinition(found[0])) or found[0], sentence)


def _definition(algorithm: Any, name: str) -> QgsProcessingParameterDefinition | None:
    own = {**_OTHER_NAMES, **getattr(algorithm, "OPTION_NAMES", {})}
    wanted = own.get(name, name.upper().replace("-", "_"))
    definition: QgsProcessingParameterDefinition | None = algorithm.parameterDefinition(wanted)
    return definition


def _label_elsewhere(option: str) -> str:
    """The label of an option of another command, without the heading that a dialog may put before it."""
    found = (
        s
        for group in vars(parameters).values()
        if isinstance(group, type) and issubclass(group, ParameterSet)
        for s in group.specifications()
    )
    return next((f"“{_field_label(s)}”" for s in found if s.option == option), "")


def _field_label(specification: Specification) -> str:
    return tr(specification.label) + (f" ({specification.unit})" if specification.unit else "")


def _quoted(definition: QgsProcessingParameterDefinition | None) -> str:
    return "" if definition is None else f"“{definition.description()}”"


def _is_value(definition: Any, word: str) -> bool:
    if definition.type() == "crs":
        return word.startswith("EPSG:")
    return definition.type() == "enum" and word in definition.options()


class DialogFeedback:
    """A feedback that shows the engine's warnings and notes in the dialog's words; all else is the given one's."""

    def __init__(self, feedback: Any, algorithm: QgsProcessingAlgorithm, groups: Groups) -> None:
        self._feedback, self._algorithm, self._groups = feedback, algorithm, groups

    def __getattr__(self, name: str) -> Any:
        return getattr(self._feedback, name)

    def pushWarning(self, warning: str) -> None:
        self._feedback.pushWarning(in_dialog_words(self._algorithm, self._groups, warning))

    def pushInfo(self, info: str) -> None:
        self._feedback.pushInfo(in_dialog_words(self._algorithm, self._groups, info))
