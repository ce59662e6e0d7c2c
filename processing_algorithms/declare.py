"""Parameters of the dialogs, made from the engine's specifications, and the kinds that several algorithms have."""

from __future__ import annotations

import re
from collections.abc import Sequence

from qgis.core import (
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

from ..interface.parameters import AUTO, PROFILES, PUBLISHED_WORKFLOW_ID, ParameterSet, Specification, profile_values
from ..plugin.bridge.compat import ADVANCED, DATE, DOUBLE, FILE, FOLDER, INTEGER, LINE, POLYGON
from ..plugin.bridge.words import tr

GROUP, PLACE, MORE = "slopewatch_group", "slopewatch_place", "slopewatch_more"
"""In a parameter's metadata: its heading; where a destination lies that is left temporary; whether few need it."""

CLOUD_FILTER = "Point clouds (*.las *.LAS *.laz *.LAZ);;All files (*)"
JSON_FILTER = "JSON files (*.json);;All files (*)"
SETTINGS_FILTER = "Settings (*.json *.toml);;All files (*)"
NAMES_FILTER = "Names of fields (*.json *.csv);;All files (*)"
CSV_FILTER = "CSV files (*.csv);;All files (*)"
CLOUD_OUTPUT_FILTER = "LAZ files (*.laz *.LAZ);;LAS files (*.las *.LAS)"

LAYERS = ("CENTRELINE", "FIELD_NAMES", "CLASSES")
"""Files that results are related to, as options of a command."""

Groups = Sequence[type[ParameterSet]]


def with_help(
    parameter: QgsProcessingParameterDefinition, text: str, *, advanced: bool = False
) -> QgsProcessingParameterDefinition:
    """``parameter`` with its tooltip, and hidden among the advanced ones if so."""
    parameter.setHelp(text)
    if advanced:
        parameter.setFlags(parameter.flags() | ADVANCED)
    return parameter


def in_group(
    parameter: QgsProcessingParameterDefinition, title: str, *, more: str = GROUP
) -> QgsProcessingParameterDefinition:
    """``parameter`` under a heading of the dialog, in QGIS's language; ``more`` is another detail of its metadata."""
    parameter.setMetadata({**parameter.metadata(), more: tr(title) if more == GROUP else title})
    return parameter


def settings_parameter() -> QgsProcessingParameterDefinition:
    """The settings of a former run; in a dialog, choosing a file fills its values in."""
    parameter = QgsProcessingParameterFile(
        "SETTINGS", "Settings of a former run", behavior=FILE, optional=True, fileFilter=SETTINGS_FILTER
    )
    parameter.setMetadata({"widget_wrapper": {"class": f"{__package__}.settings_widget.SettingsWidget"}})
    return with_help(
        parameter,
        "The run.json of a former run, or a JSON or TOML file of names and values. Choosing one fills its values in, "
        "where each can be changed. In scripts it decides the values that are not given. Paths are not taken from it.",
        advanced=True,
    )


def from_specification(
    specification: Specification, *, title: str = "", advanced: bool | None = None
) -> QgsProcessingParameterDefinition:
    """The Processing parameter of one specification; ``title`` is the heading of its stage in a long dialog."""
    s = specification
    label = tr(s.label) + (f" ({tr(s.unit)})" if s.unit else "")
    if title and title.lower() not in s.label.lower():
        label = tr("{0}: {1}").format(tr(title), f"{label[:1].lower()}{label[1:]}")
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
        parameter = QgsProcessingParameterNumber(s.qgis_name, label, number, s.field_default, optional=s.automatic)
        if s.field_minimum is not None:
            parameter.setMinimum(s.field_minimum)
        if s.maximum is not None:
            parameter.setMaximum(s.maximum)
        if s.kind is float:
            parameter.setMetadata({"widget_wrapper": {"decimals": _decimals(s)}})
    else:
        parameter = QgsProcessingParameterString(s.qgis_name, label, s.default, optional=not s.default)
    text = tr(s.help)
    if s.automatic:
        text = re.sub(rf"\b{AUTO}[:：]", tr("Not set:"), text)
    with_help(parameter, text, advanced=s.advanced if advanced is None else advanced)
    return in_group(parameter, title)


def _decimals(specification: Specification) -> int:
    """Decimals that the field shows: enough for the default and the bounds, at least two."""
    numbers = (specification.field_default, specification.minimum, specification.maximum)
    texts = [f"{n:.6f}".rstrip("0").partition(".")[2] for n in numbers if n is not None]
    return max(2, *(len(t) for t in texts))


def profile_parameter(groups: Groups) -> QgsProcessingParameterDefinition:
    """The named sets of values; in a dialog, choosing one fills its values in."""
    parameter = QgsProcessingParameterEnum(
        "PROFILE", "Profile", list(PROFILES), defaultValue="default", usesStaticStrings=True
    )
    named = {name for profile in PROFILES.values() for values in profile.values() for name in values}
    filled = {
        profile: {
            s.qgis_name: None if s.automatic and values[s.name] == AUTO else values[s.name]
            for s in specifications(groups)
            if s.name in named
        }
        for profile in PROFILES
        for values in [profile_values(groups, profile)]
    }
    parameter.setMetadata(
        {"widget_wrapper": {"class": f"{__package__}.profile_widget.ProfileWidget", "filled": filled}}
    )
    return with_help(
        parameter,
        "default: the settings that performed best. paper: the settings of the published workflow "
        f"({PUBLISHED_WORKFLOW_ID}). Choosing one fills its values in below, where each can be changed. In scripts it "
        "decides the values that are not given.",
    )


def cloud_parameter(name: str, label: str, text: str, *, optional: bool = False) -> QgsProcessingParameterDefinition:
    """A LAS or LAZ file, in a dialog also one of the clouds that are loaded.

    No parameter of a point-cloud layer: QGIS builds without PDAL refuse those.
    """
    parameter = file_parameter(name, label, text, CLOUD_FILTER, optional=optional)
    parameter.setMetadata({"widget_wrapper": {"class": f"{__package__}.cloud_widget.CloudWidget"}})
    return parameter


def file_parameter(
    name: str, label: str, text: str, pattern: str, *, optional: bool = True, advanced: bool = False
) -> QgsProcessingParameterDefinition:
    """A file of the kinds of ``pattern``."""
    parameter = QgsProcessingParameterFile(name, label, behavior=FILE, optional=optional, fileFilter=pattern)
    return with_help(parameter, text, advanced=advanced)


def folder_parameter(name: str, label: str, text: str, *, optional: bool = False) -> QgsProcessingParameterDefinition:
    return with_help(QgsProcessingParameterFile(name, label, behavior=FOLDER, optional=optional), text)


def file_destination(name: str, label: str, text: str, pattern: str) -> QgsProcessingParameterDefinition:
    """A file to write, which may be skipped."""
    parameter = QgsProcessingParameterFileDestination(name, label, pattern, optional=True, createByDefault=True)
    return with_help(parameter, text)


def cloud_destination(name: str, label: str, text: str) -> QgsProcessingParameterDefinition:
    """A LAZ file to write, which QGIS can load afterwards where it was built with PDAL."""
    if "pdal" in QgsProviderRegistry.instance().providerList():
        return with_help(QgsProcessingParameterPointCloudDestination(name, label), text)
    return with_help(QgsProcessingParameterFileDestination(name, label, CLOUD_OUTPUT_FILTER), text)


def polygon_parameter(
    name: str, label: str, text: str, *, advanced: bool = False, title: str = ""
) -> QgsProcessingParameterDefinition:
    """An optional polygon layer; ``title`` is its heading among the advanced parameters."""
    parameter = QgsProcessingParameterFeatureSource(name, label, [POLYGON], optional=True)
    return in_group(with_help(parameter, text, advanced=advanced), title)


def profiles_parameter(*, advanced: bool = False) -> QgsProcessingParameterDefinition:
    """An optional layer of lines for profiles."""
    parameter = with_help(
        QgsProcessingParameterFeatureSource("PROFILES", "Lines of profiles", [LINE], optional=True),
        "Lines in any reference system, along which the report shows the heights of both surveys and the change. Not "
        "set: profiles run down the slope through the zones only.",
        advanced=advanced,
    )
    return in_group(parameter, "Report")


def centreline_parameter(*, optional: bool = True) -> QgsProcessingParameterDefinition:
    """A layer with the road's axis; among the advanced ones where it need not be given."""
    parameter = with_help(
        QgsProcessingParameterFeatureSource(
            "CENTRELINE", "Road: centreline" if optional else "Centreline", [LINE], optional=optional
        ),
        "Lines of the road's axis in any reference system, with their route and chainages in the fields route, "
        "carriageway, chain_from and chain_to, with M values, or without. Zones get route, chainage, side and "
        "offset from it.",
        advanced=optional,
    )
    return in_group(parameter, "Road" if optional else "")


def field_names_parameter(*, advanced: bool = True) -> QgsProcessingParameterDefinition:
    """A file with the agency's names of the fields."""
    parameter = with_help(
        QgsProcessingParameterFile(
            "FIELD_NAMES",
            "Road: your names of the fields" if advanced else "Your names of the fields",
            behavior=FILE,
            optional=True,
            fileFilter=NAMES_FILTER,
        ),
        "JSON or CSV file that says how your centreline calls its fields, such as route and ROAD_NO. Not set: route, "
        "carriageway, chain_from and chain_to.",
        advanced=advanced,
    )
    return in_group(parameter, "Road" if advanced else "")


def road_parameters() -> list[QgsProcessingParameterDefinition]:
    """What places zones on a road."""
    return [centreline_parameter(), field_names_parameter()]


def classes_parameter() -> QgsProcessingParameterDefinition:
    """A layer with classes of asset."""
    return polygon_parameter(
        "CLASSES",
        "Assets: classes",
        "Polygons such as bench, drain, berm, retaining wall and pavement, in any reference system. The change is "
        "summed up for each class.",
        advanced=True,
        title="Assets",
    )


def corrections_parameter() -> QgsProcessingParameterDefinition:
    """A layer with corrections of the ground by hand."""
    return polygon_parameter(
        "CORRECTIONS",
        "Ground: corrections by hand",
        "Polygons with the field action: exclude leaves an area out of the comparison, ground takes the lowest returns "
        "there, not_ground takes none. The panel draws them.",
        advanced=True,
        title="Ground",
    )


def survey_parameters(first: str, text: str, without: str = "") -> list[QgsProcessingParameterDefinition]:
    """Two clouds with their days.

    ``first`` is the first one's label, ``text`` the help of both. ``without`` says what is done without the later one,
    which must be given where it is empty.
    """
    later = text.format("later") + without
    return [
        cloud_parameter("REFERENCE", first, text.format("first")),
        date_parameter("REFERENCE_DATE", f"Day of the {first.lower()}"),
        cloud_parameter("CLOUD", "Later survey", later, optional=bool(without)),
        date_parameter("CLOUD_DATE", "Day of the later survey"),
    ]


def transform_parameter(more: str = "") -> QgsProcessingParameterDefinition:
    """The motion of the later survey; ``more`` is added to its help."""
    text = "Transform that Register epochs wrote, where the later survey has not been moved by it yet."
    return file_parameter("TRANSFORM", "Transform", text + more, JSON_FILTER)


def roi_parameter(whole: str, effect: str = "Larger takes longer") -> QgsProcessingParameterDefinition:
    """The slope's polygons; ``whole`` says what is taken without them, ``effect`` what they do."""
    text = f"Polygons of the slope, in any reference system. {effect}; not set: {whole}."
    return polygon_parameter("ROI", "Region of interest", text)


def date_parameter(name: str, label: str) -> QgsProcessingParameterDefinition:
    return with_help(
        QgsProcessingParameterDateTime(name, label, DATE, optional=True),
        "Day of the survey. Not set: taken from the file's name where that has one, such as slope_2024-05-01.laz.",
    )


def specifications(groups: Groups) -> tuple[Specification, ...]:
    return tuple(s for group in groups for s in group.specifications())
