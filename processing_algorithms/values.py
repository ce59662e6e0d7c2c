"""What a user gave to one run of an algorithm: files, layers and days as the engine takes them, and its options."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qgis.core import QgsProcessingAlgorithm, QgsProcessingContext, QgsProcessingException, QgsProcessingFeedback

from ..interface.dates import date_in_name
from ..interface.parameters import AUTO, ParameterError, Specification, profile_values
from ..interface.settings_file import GivenSettings, read_settings
from ..plugin.bridge.cloud_layers import resolved
from .declare import Groups

_AUTOMATIC = (None, "", AUTO)
"""What a field that is left to the data or the machine holds."""
_VECTOR_FORMATS = ["gpkg", "shp", "geojson", "json", "kml", "gml", "fgb"]


@dataclass
class Values:
    """The values of a run, by the names of the algorithm's parameters."""

    algorithm: QgsProcessingAlgorithm
    parameters: dict[str, Any]
    context: QgsProcessingContext
    feedback: QgsProcessingFeedback
    folder: str = ""

    def file(self, name: str) -> str:
        """Absolute path of an input file, which a loaded cloud's name may stand for; empty if it is not given."""
        path = self.algorithm.parameterAsFile(self.parameters, name, self.context)
        path = resolved(path, self.context.project())
        return os.path.abspath(path) if path else ""

    def output_file(self, name: str) -> str:
        """Absolute path of a file to write; empty if it is skipped."""
        path = ""
        if self.algorithm.parameterDefinition(name).type() == "pointCloudDestination":
            path = self.algorithm.parameterAsOutputLayer(self.parameters, name, self.context)
        path = path or self.algorithm.parameterAsFileOutput(self.parameters, name, self.context)
        return os.path.abspath(path) if path else ""

    def output_folder(self) -> str:
        """Absolute path of the folder; asked for once a run, because a temporary one is another at each call."""
        if not self.folder:
            folder = self.algorithm.parameterAsFileOutput(self.parameters, "OUTPUT_FOLDER", self.context)
            if not folder:
                raise QgsProcessingException("OUTPUT_FOLDER is empty; give the folder that the results are written to.")
            self.folder = os.path.abspath(folder)
        return self.folder

    def polygons(self, name: str) -> str:
        """Path of a file with polygons or lines; a selection, a filter or a layer in memory is exported first."""
        if self.parameters.get(name) in (None, ""):
            return ""
        path = self.algorithm.parameterAsCompatibleSourceLayerPath(
            self.parameters, name, self.context, _VECTOR_FORMATS, "gpkg", self.feedback
        )
        if not path:
            raise QgsProcessingException(self.algorithm.invalidSourceError(self.parameters, name))
        return os.path.abspath(path)

    def source_layer(self, name: str) -> tuple[str, str]:
        """Path of a file with features and the layer's name there, empty where the file has one; exported as above."""
        path, layer = self.algorithm.parameterAsCompatibleSourceLayerPathAndLayerName(
            self.parameters, name, self.context, _VECTOR_FORMATS, "gpkg", self.feedback
        )
        if not path:
            raise QgsProcessingException(self.algorithm.invalidSourceError(self.parameters, name))
        return os.path.abspath(path), str(layer or "")

    def options(self, *names: str) -> list[str]:
        """Options for those of the files, destinations and layers that are given; the engine names each alike."""
        arguments = []
        for name in names:
            definition = self.algorithm.parameterDefinition(name)
            read = self.output_file if definition.isDestination() else self.polygons
            path = self.file(name) if definition.type() == "file" else read(name)
            arguments += [f"--{name.lower().replace('_', '-')}", path] if path else []
        return arguments

    def pair_days(self) -> list[str]:
        """Days of the surveys REFERENCE and CLOUD, empty where unknown."""
        return [self.survey_date(f"{name}_DATE", self.file(name)) for name in ("REFERENCE", "CLOUD")]

    def pair_options(self) -> list[str]:
        """Options for those of the two days that are known."""
        days = zip(("--epoch-from", "--epoch-to"), self.pair_days())
        return [part for option, day in days if day for part in (option, day)]

    def survey_date(self, name: str, path: str) -> str:
        """Day of a survey as YYYY-MM-DD: the parameter ``name``, else from the file's name; empty if unknown."""
        given = self.algorithm.parameterAsDateTime(self.parameters, name, self.context)
        if given.isValid():
            return str(given.date().toString("yyyy-MM-dd"))
        if self.parameters.get(name):
            raise QgsProcessingException(f"{name} is {self.parameters[name]!r}; give a day such as 2024-05-01.")
        day = date_in_name(Path(path))
        return day.isoformat() if day else ""

    def settings(self, groups: Groups) -> list[str]:
        """Options of the profile and of the parameters that are given and differ from the profile's."""
        path = self.file("SETTINGS") if groups else ""
        read = _settings(path, groups)
        arguments = ["--settings", path] if path else []
        profile = read.profile or "default"
        if self.algorithm.parameterDefinition("PROFILE") is not None:
            if self.parameters.get("PROFILE") not in (None, ""):
                profile = self._choice("PROFILE")
            arguments += ["--profile", profile] if profile != (read.profile or "default") else []
        used = profile_values(groups, profile) | read.over(groups, profile)
        for s in (s for group in groups for s in group.specifications()):
            value = self._read(s)
            if value is None or _same(value, used[s.name]):
                continue
            if s.kind is bool:
                arguments.append(f"--{s.option}" if value else f"--no-{s.option}")
            else:
                arguments += [f"--{s.option}", str(value)]
        return arguments

    def _choice(self, name: str) -> str:
        return str(self.algorithm.parameterAsEnumString(worded(self.algorithm, self.parameters), name, self.context))

    def _read(self, s: Specification) -> Any:
        """The value of a parameter, AUTO for an emptied field; None where it is not given."""
        raw = self.parameters.get(s.qgis_name)
        if s.automatic and s.qgis_name in self.parameters and raw in _AUTOMATIC:
            return AUTO
        if raw is None:
            return None
        given = self.parameters, s.qgis_name, self.context
        if s.name == "crs":
            crs = self.algorithm.parameterAsCrs(*given)
            return (crs.authid() or crs.toWkt()) if crs.isValid() else ""
        if s.kind is bool:
            return self.algorithm.parameterAsBoolean(*given)
        if s.kind in (int, float):
            read = self.algorithm.parameterAsInt if s.kind is int else self.algorithm.parameterAsDouble
            number = read(*given)
            return AUTO if number == s.auto_number else number
        if s.choices:
            return self._choice(s.qgis_name)
        return self.algorithm.parameterAsString(*given).strip()


def _settings(path: str, groups: Groups) -> GivenSettings:
    try:
        return read_settings(Path(path), groups) if path else GivenSettings({})
    except ParameterError as error:
        raise QgsProcessingException(f"{error}.") from None


def worded(algorithm: QgsProcessingAlgorithm, parameters: Any) -> dict[str, Any]:
    """The values with the number of a choice replaced by its word: qgis_process's help offers the numbers too."""
    result = dict(parameters)
    for parameter in algorithm.parameterDefinitions():
        number = str(result.get(parameter.name(), ""))
        if parameter.type() == "enum" and number.isdecimal() and int(number) < len(parameter.options()):
            result[parameter.name()] = parameter.options()[int(number)]
    return result


def problem(groups: Groups, parameters: Any) -> str | None:
    """The sentence for the first value that cannot be used, in the engine's words; None if there is none."""
    if groups and isinstance(parameters.get("SETTINGS"), str) and parameters["SETTINGS"]:
        try:
            read_settings(Path(parameters["SETTINGS"]), groups)
        except ParameterError as error:
            return f"{error}."
    for s in (s for group in groups for s in group.specifications()):
        raw = parameters.get(s.qgis_name)
        if s.kind not in (int, float) or not (isinstance(raw, str) or type(raw) in (int, float)):
            continue
        if s.automatic and raw in _AUTOMATIC:
            continue
        try:
            s.check(_number(raw))
        except ParameterError as error:
            return f"{error}."
    return None


def _number(raw: Any) -> Any:
    """A number; what is none as it is, for the sentence that says so: QGIS takes any text for an optional number."""
    try:
        return float(raw)
    except ValueError:
        return raw


def _same(value: Any, other: Any) -> bool:
    if isinstance(other, float) and not isinstance(value, str):
        return math.isclose(value, other, rel_tol=1e-9, abs_tol=1e-12)
    return bool(value == other)
