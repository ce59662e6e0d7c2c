"""The engine's sentences in the words of a dialog: what it calls --crs is the parameter's name there."""

from __future__ import annotations

import re
from typing import Any

from qgis.core import QgsProcessingAlgorithm, QgsProcessingParameterDefinition

from ..interface.parameters import AUTO
from .declare import Groups, specifications

# Options of every command that no dialog has.
_ELSEWHERE = {"pdal": "“PDAL program” under Settings > Options > SlopeWatch"}
# An option, alone or with its value; not within a path or another word.
_OPTION = re.compile(r"(?<![\w/\\.-])--([a-z][a-z0-9-]*)(?: (EPSG:[A-Za-z0-9+]+|[A-Za-z0-9_]+))?(?![\w/\\])")
# A parameter as Python calls it: a name with an underscore, or one that begins the sentence.
_NAME = re.compile(r"(?<![\w/\\.-])[a-z][a-z0-9]*(?:_[a-z0-9]+)+(?![\w/\\-]|\.\w)|^[a-z][a-z0-9]*(?= is )")

# What a number is given for AUTO, at the end of a parameter's bounds.
_AUTO = re.compile(rf", or {AUTO}(?=[.;]|$)")


def in_dialog_words(algorithm: QgsProcessingAlgorithm, groups: Groups, sentence: str) -> str:
    """``sentence`` with command-line options and the engine's names of parameters replaced by the dialog's names.

    ``--crs`` becomes “Coordinate reference system”, and ``--ground extract`` becomes extract in “Ground points”. What
    the dialog does not have stays as it is.
    """
    names = {s.name for s in specifications(groups)}

    def option(found: re.Match[str]) -> str:
        name, value = found[1], found[2]
        definition = _definition(algorithm, name)
        if definition is None and name not in _ELSEWHERE:
            return found[0]
        label = _ELSEWHERE[name] if definition is None else _quoted(definition)
        if not value:
            return label
        return f"{value} in {label}" if definition is not None and _is_value(definition, value) else f"{label} {value}"

    def parameter(found: re.Match[str]) -> str:
        definition = _definition(algorithm, found[0]) if found[0] in names else None
        return found[0] if definition is None else _quoted(definition)

    return _AUTO.sub(", or leave it empty", _NAME.sub(parameter, _OPTION.sub(option, sentence)))


def _definition(algorithm: QgsProcessingAlgorithm, name: str) -> QgsProcessingParameterDefinition | None:
    definition: QgsProcessingParameterDefinition | None = algorithm.parameterDefinition(name.upper().replace("-", "_"))
    return definition


def _quoted(definition: QgsProcessingParameterDefinition) -> str:
    return f"“{definition.description()}”"


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
