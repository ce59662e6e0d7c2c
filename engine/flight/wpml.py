"""Flight lines as missions for aircraft of DJI: KMZ files of the waypoint markup language (WPML) 1.0.2.

Source: DJI Cloud API, "DJI WPML": template.kml, waylines.wpml and common elements; all elements that these name as
required are written, and none that they do not name.
"""

from __future__ import annotations

import io
import itertools
import math
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pyproj import CRS

from ...interface.parameters import FlightParameters, MissionParameters
from ..core.arrays import Bool, Float
from ..core.errors import InputError
from ..core.messages import quoted
from ..core.staged_outputs import atomic_output
from .kml import to_wgs84
from .lines import Line, clearance_of
from .terrain import Terrain

MAX_WAYPOINTS = 65_536
"""Of one file, as their numbers go from 0 to 65,535."""
MAX_MISSIONS = 99
MAX_SPEED_M_S = 15.0
"""Fastest way to the first waypoint that the language allows."""
LOWEST_M, HIGHEST_M = -1000.0, 10_000.0
"""Between which the height of a take-off point may lie."""
MIN_SAFE_HEIGHT_M, MAX_SAFE_HEIGHT_M = 2.0, 1500.0
_TURN_M, _TURN_SHARE = (
    2.0,
    0.4,
)  # before a waypoint on a line at which the turn begins, and of the shorter way next to it
_SPACES = {"xmlns": "http://www.opengis.net/kml/2.2", "xmlns:wpml": "http://www.dji.com/wpmz/1.0.2"}
_MOMENT = (1980, 1, 1, 0, 0, 0)  # of the files inside, which the clock would make differ
_DOWN_DEG = -90.0
_STEP_M = 1.0  # between the places of a way at which its distance to the ground is looked at


@dataclass(frozen=True)
class Mission:
    """What one file flies: the numbers of its ``lines``, waypoints ``xyz`` (n, 3) in their order, metres, and whether
    the aircraft stops at each (n,), as it does at the ends of lines.
    """

    lines: tuple[int, ...]
    xyz: Float
    stops: Bool


def missions_of(lines: Sequence[Line], battery: Sequence[int], most: int = MAX_WAYPOINTS) -> list[Mission]:
    """The lines of each battery (k,) as a mission of its own, and as several where they have more than ``most``
    waypoints; a line with more is continued where it was cut.

    Raises:
        InputError: more than ``MAX_MISSIONS`` are needed.
    """
    made: list[list[tuple[int, Float]]] = []
    last, count = None, 0
    for line, own in zip(lines, battery, strict=True):
        # parts share the waypoint at which they were cut
        for first in range(0, len(line.xyz) - 1, most - 1):
            part = line.xyz[first : first + most]
            if own != last or count + len(part) > most:
                made.append([])
                count = 0
            made[-1].append((line.number, part))
            last, count = own, count + len(part)
    if len(made) > MAX_MISSIONS:
        raise InputError(f"The plan needs {len(made)} mission files, more than {MAX_MISSIONS}; divide the region.")
    return [_mission(parts) for parts in made]


def _mission(parts: Sequence[tuple[int, Float]]) -> Mission:
    stops = [np.isin(np.arange(len(xyz)), (0, len(xyz) - 1)) for _, xyz in parts]
    numbers = tuple(dict.fromkeys(number for number, _ in parts))
    return Mission(numbers, np.concatenate([xyz for _, xyz in parts]), np.concatenate(stops))


@dataclass(frozen=True)
class TakeOff:
    """Heights of the take-off point, metres: as the terrain counts them, and above the ellipsoid of WGS 84."""

    height: float
    ellipsoid: float


def take_off(parameters: MissionParameters) -> TakeOff:
    """The heights that a mission begins at.

    Raises:
        InputError: one is missing, is no number, or none that a place on earth has.
    """
    return TakeOff(
        _height(parameters.takeoff_height, "--takeoff-height", "as the terrain counts heights"),
        _height(parameters.takeoff_ellipsoid_height, "--takeoff-ellipsoid-height", "above the ellipsoid of WGS 84"),
    )


def _height(text: str, option: str, zero: str) -> float:
    if not text.strip():
        raise InputError(f"A mission file for an aircraft of DJI needs {option}, the take-off point's height {zero}.")
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not LOWEST_M <= found <= HIGHEST_M:
        raise InputError(f"{option} is {quoted(text)}; give a height in metres {zero}.")
    return found


def refuse_mission(parameters: MissionParameters, flight: FlightParameters) -> None:
    """Raise InputError where something is missing that a mission file cannot be without."""
    if not parameters.wpml_payload:
        raise InputError(
            "A mission file for an aircraft of DJI needs --wpml-payload, the payload's number in DJI's tables."
        )
    take_off(parameters)
    if flight.flying_speed > MAX_SPEED_M_S:
        raise InputError(
            f"A mission file for an aircraft of DJI takes at most {MAX_SPEED_M_S:g} m/s, and --flying-speed is "
            f"{flight.flying_speed:g}; give a lower one, or leave --wpml-drone out."
        )


def refuse_ways(lines: Sequence[Line], terrain: Terrain, flight: FlightParameters) -> None:
    """Raise InputError where the straight way from a line to the next one comes too near to ground or plants.

    A pilot would fly around it; a mission flies it.
    """
    for line, after in itertools.pairwise(lines):
        start, end = line.xyz[-1], after.xyz[0]
        count = max(2, int(np.ceil(np.linalg.norm(end - start) / _STEP_M)) + 1)
        track = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        ground = terrain.at(track[:, :2])
        ground = np.where(np.isfinite(ground), ground, track[:, 2] - flight.altitude)
        found = clearance_of(Line(line.number, track[[0, -1]], ground[[0, -1]], track, ground), terrain)
        if found < flight.clearance:
            raise InputError(
                f"The way from line {line.number} to line {after.number} comes within {max(found, 0.0):.1f} m of "
                f"ground or plants, and --clearance asks for {flight.clearance:g} m; raise --altitude, or leave "
                "--wpml-drone out and fly the ways by hand."
            )


def write_mission(
    path: Path, mission: Mission, crs: CRS, parameters: MissionParameters, flight: FlightParameters
) -> None:
    """Write a KMZ file with template.kml and waylines.wpml, the same bytes for the same plan.

    Heights are above the take-off point, which is the same in every system of heights as far as a slope reaches.
    """
    begin = take_off(parameters)
    above = mission.xyz[:, 2] - begin.height
    top = float(above.max())
    if top > MAX_SAFE_HEIGHT_M:
        raise InputError(
            f"The lines lie up to {top:.0f} m above the take-off point, and a mission file takes at most "
            f"{MAX_SAFE_HEIGHT_M:g}; check --takeoff-height, which is counted as the terrain's heights are."
        )
    places = to_wgs84(mission.xyz, crs)
    ellipsoid = above + begin.ellipsoid
    template, waylines = _root(), _root()
    for root in (template, waylines):
        _configuration(root[0], max(top, MIN_SAFE_HEIGHT_M), parameters, flight)
    _template(template[0], mission, places, above, ellipsoid, flight)
    _waylines(waylines[0], mission, places, above, parameters, flight)
    with atomic_output(path) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, root in (("wpmz/template.kml", template), ("wpmz/waylines.wpml", waylines)):
            ET.indent(root)
            text = io.BytesIO()
            ET.ElementTree(root).write(text, encoding="utf-8", xml_declaration=True)
            archive.writestr(zipfile.ZipInfo(name, _MOMENT), text.getvalue(), zipfile.ZIP_DEFLATED)


def _root() -> ET.Element:
    root = ET.Element("kml", _SPACES)
    ET.SubElement(root, "Document")
    return root


def _add(parent: ET.Element, name: str, value: object = None) -> ET.Element:
    element = ET.SubElement(parent, f"wpml:{name}")
    if value is not None:
        element.text = str(value)
    return element


def _configuration(
    document: ET.Element, safe_height: float, parameters: MissionParameters, flight: FlightParameters
) -> None:
    """What holds for the whole mission: the aircraft climbs higher than all waypoints before it comes and goes."""
    config = _add(document, "missionConfig")
    for name, value in (
        ("flyToWaylineMode", "safely"),
        ("finishAction", "goHome"),
        ("exitOnRCLost", "executeLostAction"),
        ("executeRCLostAction", "goBack"),
        ("takeOffSecurityHeight", f"{safe_height:.1f}"),
        ("globalTransitionalSpeed", f"{flight.flying_speed:g}"),
        ("globalRTHHeight", f"{safe_height:.1f}"),
    ):
        _add(config, name, value)
    drone = _add(config, "droneInfo")
    _add(drone, "droneEnumValue", parameters.wpml_drone)
    _add(drone, "droneSubEnumValue", 0)
    payload = _add(config, "payloadInfo")
    _add(payload, "payloadEnumValue", parameters.wpml_payload)
    _add(payload, "payloadPositionIndex", parameters.wpml_payload_position)


def _template(
    document: ET.Element, mission: Mission, places: Float, above: Float, ellipsoid: Float, flight: FlightParameters
) -> None:
    """The folder of template.kml, which ground stations show and edit."""
    folder = ET.SubElement(document, "Folder")
    _add(folder, "templateType", "waypoint")
    _add(folder, "templateId", 0)
    system = _add(folder, "waylineCoordinateSysParam")
    _add(system, "coordinateMode", "WGS84")
    _add(system, "heightMode", "relativeToStartPoint")
    _add(folder, "autoFlightSpeed", f"{flight.flying_speed:g}")
    _add(folder, "globalWaypointTurnMode", "toPointAndStopWithDiscontinuityCurvature")
    _add(folder, "gimbalPitchMode", "usePointSetting")
    _add(folder, "globalHeight", f"{above.max():.3f}")
    _heading(_add(folder, "globalWaypointHeadingParam"))
    for index, mark in enumerate(_placemarks(folder, places)):
        _add(mark, "useGlobalHeight", 0)
        _add(mark, "ellipsoidHeight", f"{ellipsoid[index]:.3f}")
        _add(mark, "height", f"{above[index]:.3f}")
        _add(mark, "useGlobalSpeed", 1)
        _add(mark, "useGlobalHeadingParam", 1)
        _add(mark, "useGlobalTurnParam", 0)
        _turn(mark, mission, index)
        _add(mark, "gimbalPitchAngle", f"{_DOWN_DEG:g}")


def _waylines(
    document: ET.Element,
    mission: Mission,
    places: Float,
    above: Float,
    parameters: MissionParameters,
    flight: FlightParameters,
) -> None:
    """The folder of waylines.wpml, which the aircraft flies."""
    folder = ET.SubElement(document, "Folder")
    _add(folder, "templateId", 0)
    _add(folder, "executeHeightMode", "relativeToStartPoint")
    _add(folder, "waylineId", 0)
    _add(folder, "autoFlightSpeed", f"{flight.flying_speed:g}")
    for index, mark in enumerate(_placemarks(folder, places)):
        _add(mark, "executeHeight", f"{above[index]:.3f}")
        _add(mark, "waypointSpeed", f"{flight.flying_speed:g}")
        _heading(_add(mark, "waypointHeadingParam"))
        _turn(mark, mission, index)
        if index == 0:
            _look_down(mark, parameters.wpml_payload_position)


def _placemarks(folder: ET.Element, places: Float) -> list[ET.Element]:
    marks = []
    for index, (longitude, latitude) in enumerate(places):
        mark = ET.SubElement(folder, "Placemark")
        point = ET.SubElement(mark, "Point")
        ET.SubElement(point, "coordinates").text = f"{longitude:.9f},{latitude:.9f}"
        _add(mark, "index", index)
        marks.append(mark)
    return marks


def _heading(parent: ET.Element) -> None:
    _add(parent, "waypointHeadingMode", "followWayline")
    _add(parent, "waypointHeadingPathMode", "followBadArc")


def _turn(mark: ET.Element, mission: Mission, index: int) -> None:
    """At the ends of lines the aircraft stops; on a line it passes, as stops would pile up returns."""
    turn = _add(mark, "waypointTurnParam")
    if mission.stops[index]:
        _add(turn, "waypointTurnMode", "toPointAndStopWithDiscontinuityCurvature")
        _add(turn, "waypointTurnDampingDist", 0)
        return
    ways = np.linalg.norm(np.diff(mission.xyz[index - 1 : index + 2], axis=0), axis=1)
    _add(turn, "waypointTurnMode", "coordinateTurn")
    _add(turn, "waypointTurnDampingDist", f"{min(_TURN_M, _TURN_SHARE * float(ways.min())):.2f}")


def _look_down(mark: ET.Element, position: int) -> None:
    """An action at the first waypoint: the gimbal looks straight down, as the plan's beams do."""
    group = _add(mark, "actionGroup")
    for name in ("actionGroupId", "actionGroupStartIndex", "actionGroupEndIndex"):
        _add(group, name, 0)
    _add(group, "actionGroupMode", "sequence")
    _add(_add(group, "actionTrigger"), "actionTriggerType", "reachPoint")
    action = _add(group, "action")
    _add(action, "actionId", 0)
    _add(action, "actionActuatorFunc", "gimbalRotate")
    parameters = _add(action, "actionActuatorFuncParam")
    _add(parameters, "payloadPositionIndex", position)
    _add(parameters, "gimbalHeadingYawBase", "north")
    _add(parameters, "gimbalRotateMode", "absoluteAngle")
    for axis in ("Pitch", "Roll", "Yaw"):
        _add(parameters, f"gimbal{axis}RotateEnable", int(axis == "Pitch"))
        _add(parameters, f"gimbal{axis}RotateAngle", f"{_DOWN_DEG if axis == 'Pitch' else 0:g}")
    _add(parameters, "gimbalRotateTimeEnable", 0)
    _add(parameters, "gimbalRotateTime", 0)
