"""Parameters of the dialogs, made from the engine's specifications, and back into command-line options."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDateTime,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterPointCloudDestination,
    QgsProcessingParameterString,
    QgsProviderRegistry,
)

from ..interface.parameters import AUTO, PROFILES, ParameterError, ParameterSet, Specification
from ..plugin.bridge.compat import ADVANCED, DATE, DOUBLE, FILE, INTEGER, LINE, POLYGON

CLOUD_FILTER = "Point clouds (*.las *.LAS *.laz *.LAZ);;All files (*)"
CLOUD_OUTPUT_FILTER = "LAZ files (*.laz *.LAZ);;LAS files (*.las *.LAS)"

Groups = Sequence[type[ParameterSet]]


def with_help(
    parameter: QgsProcessingParameterDefinition, text: str, *, advanced: bool = False
) -> QgsProcessingParameterDefinition:
    """``parameter`` with its tooltip, and hidden among the advanced ones if so."""
    parameter.setHelp(text)
    if advanced:
        parameter.setFlags(parameter.flags() | ADVANCED)
    return parameter


def from_specification(
    specification: Specification, *, prefix: str = "", advanced: bool | None = None
) -> QgsProcessingParameterDefinition:
    """The Processing parameter of one specification; ``prefix`` names its stage in a long dialog."""
    s = specification
    label = s.field_label
    if prefix and prefix.lower() not in label.lower():
        label = f"{prefix}: {label[:1].lower()}{label[1:]}"
    parameter: QgsProcessingParameterDefinition
    if s.name == "crs":
        parameter = QgsProcessingParameterCrs(s.qgis_name, label, optional=True)
    elif s.kind is bool:
        parameter = QgsProcessingParameterBoolean(s.qgis_name, label, s.default)
    elif s.choices:
        parameter = QgsProcessingParameterEnum(
            s.qgis_name, label, list(s.choices), defaultValue=s.default, usesStaticStrings=True
        )
    elif s.kind in (int, float):
        number = INTEGER if s.kind is int else DOUBLE
        parameter = QgsProcessingParameterNumber(s.qgis_name, label, number, s.field_default)
        if s.field_minimum is not None:
            parameter.setMinimum(s.field_minimum)
        if s.maximum is not None:
            parameter.setMaximum(s.maximum)
        if s.kind is float:
            parameter.setMetadata({"widget_wrapper": {"decimals": _decimals(s)}})
    else:
        parameter = QgsProcessingParameterString(s.qgis_name, label, s.default, optional=not s.default)
    return with_help(parameter, s.help, advanced=s.advanced if advanced is None else advanced)


def _decimals(specification: Specification) -> int:
    """Decimals that the field shows: enough for the default and the bounds, at least two."""
    numbers = (specification.field_default, specification.minimum, specification.maximum)
    texts = [f"{n:.6f}".rstrip("0").partition(".")[2] for n in numbers if n is not None]
    return max(2, *(len(t) for t in texts))


def profile_parameter() -> QgsProcessingParameterDefinition:
    return with_help(
        QgsProcessingParameterEnum(
            "PROFILE", "Profile", list(PROFILES), defaultValue="default", usesStaticStrings=True
        ),
        "default: the settings that measured best. paper: the published settings. A value left at its default "
        "is decided by the profile, any other value overrides it.",
    )


def profile_options(algorithm: QgsProcessingAlgorithm, parameters: Any, context: QgsProcessingContext) -> list[str]:
    profile = algorithm.parameterAsEnumString(worded(algorithm, parameters), "PROFILE", context)
    return ["--profile", profile] if profile and profile != "default" else []


def options(
    algorithm: QgsProcessingAlgorithm, groups: Groups, parameters: Any, context: QgsProcessingContext
) -> list[str]:
    """Command-line options of the values that differ from their defaults."""
    arguments: list[str] = []
    for group in groups:
        for s in group.specifications():
            value = _read(algorithm, s, parameters, context)
            if _same(value, s.default):
                continue
            if s.kind is bool:
                arguments.append(f"--{s.option}" if value else f"--no-{s.option}")
            else:
                arguments += [f"--{s.option}", str(value)]
    return arguments


def worded(algorithm: QgsProcessingAlgorithm, parameters: Any) -> dict[str, Any]:
    """The values with the number of a choice replaced by its word: qgis_process's help offers the numbers too."""
    result = dict(parameters)
    for parameter in algorithm.parameterDefinitions():
        number = str(result.get(parameter.name(), ""))
        if parameter.type() == "enum" and number.isdecimal() and int(number) < len(parameter.options()):
            result[parameter.name()] = parameter.options()[int(number)]
    return result


def problem(
    algorithm: QgsProcessingAlgorithm, groups: Groups, parameters: Any, context: QgsProcessingContext
) -> str | None:
    """The sentence for the first value that is out of bounds, in the engine's words; None if there is none."""
    for group in groups:
        for s in group.specifications():
            raw = parameters.get(s.qgis_name)
            if raw is None or not (isinstance(raw, str) or type(raw) in (int, float)) or s.kind not in (int, float):
                continue
            try:
                s.check(float(raw))
            except ValueError as error:
                return f"{error}." if isinstance(error, ParameterError) else None
    return None


def _read(algorithm: QgsProcessingAlgorithm, s: Specification, parameters: Any, context: QgsProcessingContext) -> Any:
    if s.name == "crs":
        crs = algorithm.parameterAsCrs(parameters, s.qgis_name, context)
        return (crs.authid() or crs.toWkt()) if crs.isValid() else ""
    if s.kind is bool:
        return algorithm.parameterAsBoolean(parameters, s.qgis_name, context)
    if s.kind in (int, float):
        read = algorithm.parameterAsInt if s.kind is int else algorithm.parameterAsDouble
        number = read(parameters, s.qgis_name, context)
        return AUTO if number == s.auto_number else number
    if s.choices:
        return algorithm.parameterAsEnumString(worded(algorithm, parameters), s.qgis_name, context)
    return algorithm.parameterAsString(parameters, s.qgis_name, context).strip()


def _same(value: Any, default: Any) -> bool:
    if isinstance(default, float):
        return math.isclose(value, default, rel_tol=1e-9, abs_tol=1e-12)
    return bool(value == default)


def cloud_parameter(name: str, label: str, text: str, *, optional: bool = False) -> QgsProcessingParameterDefinition:
    """A LAS or LAZ file. Not a point cloud layer: QGIS builds without PDAL refuse those."""
    return with_help(
        QgsProcessingParameterFile(name, label, behavior=FILE, optional=optional, fileFilter=CLOUD_FILTER), text
    )


def cloud_destination(name: str, label: str, text: str) -> QgsProcessingParameterDefinition:
    """A LAZ file to write, which QGIS can load afterwards where it was built with PDAL."""
    if "pdal" in QgsProviderRegistry.instance().providerList():
        return with_help(QgsProcessingParameterPointCloudDestination(name, label), text)
    return with_help(QgsProcessingParameterFileDestination(name, label, CLOUD_OUTPUT_FILTER), text)


def polygon_parameter(name: str, label: str, text: str, *, advanced: bool = False) -> QgsProcessingParameterDefinition:
    """An optional polygon layer."""
    return with_help(
        QgsProcessingParameterFeatureSource(name, label, [POLYGON], optional=True), text, advanced=advanced
    )


def profiles_parameter(*, advanced: bool = False) -> QgsProcessingParameterDefinition:
    """An optional layer of lines for profiles."""
    return with_help(
        QgsProcessingParameterFeatureSource("PROFILES", "Lines of profiles", [LINE], optional=True),
        "Lines in any reference system, along which the report shows the heights of both surveys and the change. Not "
        "set: profiles run down the slope through the zones only.",
        advanced=advanced,
    )


def date_parameter(name: str, label: str) -> QgsProcessingParameterDefinition:
    return with_help(
        QgsProcessingParameterDateTime(name, label, DATE, optional=True),
        "Day of the survey. Not set: taken from the file's name where that has one, such as slope_2024-05-01.laz.",
    )


def specifications(groups: Groups) -> tuple[Specification, ...]:
    return tuple(s for group in groups for s in group.specifications())
