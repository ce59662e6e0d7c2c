"""Mission files: what the public description of the markup language asks for, and the plan's waypoints read back."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Transformer
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.flight.lines import Line, lines_along, plan_lines
from slopewatch.engine.flight.wpml import missions_of, refuse_mission, refuse_ways, write_mission
from slopewatch.interface.parameters import MissionParameters
from slopewatch.tests.builders.flights import CRS_CODE, NORTH, WEST, flight, inclined, square

AIRCRAFT = MissionParameters(
    wpml_drone=89, wpml_payload=65534, takeoff_height="95", takeoff_ellipsoid_height="107.5"
)  # fmt: skip
WPML = "{http://www.dji.com/wpmz/1.0.2}"
KML = "{http://www.opengis.net/kml/2.2}"
# what DJI's pages "template.kml", "waylines.wpml" and "Common elements" call required of a waypoint flight
CONFIGURATION = {
    "flyToWaylineMode", "finishAction", "exitOnRCLost", "executeRCLostAction", "takeOffSecurityHeight",
    "globalTransitionalSpeed", "globalRTHHeight", "droneInfo/droneEnumValue", "droneInfo/droneSubEnumValue",
    "payloadInfo/payloadEnumValue", "payloadInfo/payloadPositionIndex",
}  # fmt: skip
TEMPLATE = {
    "templateType", "templateId", "autoFlightSpeed", "waylineCoordinateSysParam/coordinateMode",
    "waylineCoordinateSysParam/heightMode", "globalWaypointTurnMode", "gimbalPitchMode", "globalHeight",
    "globalWaypointHeadingParam/waypointHeadingMode", "globalWaypointHeadingParam/waypointHeadingPathMode",
}  # fmt: skip
TEMPLATE_POINT = {
    "index", "useGlobalHeight", "ellipsoidHeight", "height", "useGlobalSpeed", "useGlobalHeadingParam",
    "useGlobalTurnParam", "waypointTurnParam/waypointTurnMode", "waypointTurnParam/waypointTurnDampingDist",
    "gimbalPitchAngle",
}  # fmt: skip
WAYLINE = {"templateId", "waylineId", "autoFlightSpeed", "executeHeightMode"}
WAYLINE_POINT = {
    "index", "executeHeight", "waypointSpeed", "waypointHeadingParam/waypointHeadingMode",
    "waypointHeadingParam/waypointHeadingPathMode", "waypointTurnParam/waypointTurnMode",
    "waypointTurnParam/waypointTurnDampingDist",
}  # fmt: skip
ACTION = {
    "actionGroupId", "actionGroupStartIndex", "actionGroupEndIndex", "actionGroupMode",
    "actionTrigger/actionTriggerType", "action/actionId", "action/actionActuatorFunc",
    *(f"action/actionActuatorFuncParam/{name}" for name in (
        "payloadPositionIndex", "gimbalHeadingYawBase", "gimbalRotateMode", "gimbalPitchRotateEnable",
        "gimbalPitchRotateAngle", "gimbalRollRotateEnable", "gimbalRollRotateAngle", "gimbalYawRotateEnable",
        "gimbalYawRotateAngle", "gimbalRotateTimeEnable", "gimbalRotateTime",
    )),
}  # fmt: skip


@pytest.fixture(scope="module")
def lines() -> list[Line]:
    return plan_lines(square(), inclined(relief=4.0), flight(height_tolerance=0.2))


def parts(path: Path) -> tuple[ET.Element, ET.Element]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
        found = [ET.fromstring(archive.read(name)) for name in archive.namelist()]
    assert [root.tag for root in found] == [f"{KML}kml"] * 2
    return found[0][0], found[1][0]


def asked(element: ET.Element, names: set[str]) -> None:
    for name in names:
        found = element.find("/".join(f"{WPML}{part}" for part in name.split("/")))
        assert found is not None, name
        assert found.text, name


def text(element: ET.Element, name: str) -> str:
    return element.findtext(f"{WPML}{name}") or ""


def test_all_that_is_required_is_there(tmp_path: Path, lines: list[Line]) -> None:
    (mission,) = missions_of(lines, [1] * len(lines))
    write_mission(tmp_path / "m.kmz", mission, CRS.from_user_input(CRS_CODE), AIRCRAFT, flight())
    template, waylines = parts(tmp_path / "m.kmz")
    for document in (template, waylines):
        config = document.find(f"{WPML}missionConfig")
        assert config is not None
        asked(config, CONFIGURATION)
        assert text(config, "takeOffSecurityHeight") == f"{mission.xyz[:, 2].max() - 95.0:.1f}"
    for document, folder_names, names in (
        (template, TEMPLATE, TEMPLATE_POINT),
        (waylines, WAYLINE, WAYLINE_POINT),
    ):
        (folder,) = document.findall(f"{KML}Folder")
        asked(folder, folder_names)
        marks = folder.findall(f"{KML}Placemark")
        assert [text(mark, "index") for mark in marks] == [str(n) for n in range(len(mission.xyz))]
        for mark in marks:
            asked(mark, names)
            assert len((mark.findtext(f"{KML}Point/{KML}coordinates") or "").split(",")) == 2
    first = waylines.find(f"{KML}Folder/{KML}Placemark/{WPML}actionGroup")
    assert first is not None
    asked(first, ACTION)


def test_waypoints_and_heights_come_back_within_a_centimetre(tmp_path: Path, lines: list[Line]) -> None:
    """Heights are above the take-off point at 95 m, which is 107.5 m above the ellipsoid."""
    (mission,) = missions_of(lines, [1] * len(lines))
    planned = np.concatenate([line.xyz for line in lines])
    write_mission(tmp_path / "m.kmz", mission, CRS.from_user_input(CRS_CODE), AIRCRAFT, flight())
    back = Transformer.from_crs("EPSG:4326", CRS_CODE, always_xy=True)
    for document, name, beginning in zip(
        (*parts(tmp_path / "m.kmz"), parts(tmp_path / "m.kmz")[0]),
        ("height", "executeHeight", "ellipsoidHeight"),
        (95.0, 95.0, 95.0 - 107.5),
        strict=True,
    ):
        marks = document.findall(f"{KML}Folder/{KML}Placemark")
        degrees = [(mark.findtext(f"{KML}Point/{KML}coordinates") or "").split(",") for mark in marks]
        x, y = back.transform(*np.array(degrees, float).T)
        z = np.array([text(mark, name) for mark in marks], float) + beginning
        assert np.abs(np.column_stack([x, y, z]) - planned).max() < 0.01


def test_the_aircraft_stops_at_the_ends_of_lines_and_turns_within_the_ways_between(
    tmp_path: Path, lines: list[Line]
) -> None:
    (mission,) = missions_of(lines, [1] * len(lines))
    write_mission(tmp_path / "m.kmz", mission, CRS.from_user_input(CRS_CODE), AIRCRAFT, flight())
    marks = parts(tmp_path / "m.kmz")[1].findall(f"{KML}Folder/{KML}Placemark")
    ends = np.cumsum([len(line.xyz) for line in lines])
    stops = {*(ends - 1), *(ends - [len(line.xyz) for line in lines])}
    ways = np.linalg.norm(np.diff(mission.xyz, axis=0), axis=1)
    damping = []
    for number, mark in enumerate(marks):
        turn = mark.find(f"{WPML}waypointTurnParam")
        assert turn is not None
        stopped = text(turn, "waypointTurnMode") == "toPointAndStopWithDiscontinuityCurvature"
        assert stopped == (number in stops)
        damping.append(float(text(turn, "waypointTurnDampingDist")))
        assert stopped or damping[-1] > 0
    assert len(marks) > len(stops)
    assert all(a + b < way for (a, b), way in zip(itertools.pairwise(damping), ways, strict=True))


def test_a_file_for_each_battery_and_for_so_many_waypoints(lines: list[Line]) -> None:
    counts = [len(line.xyz) for line in lines]
    battery = [1] + [2] * (len(lines) - 1)
    assert [m.lines for m in missions_of(lines, battery)] == [(1,), tuple(range(2, len(lines) + 1))]
    most = max(counts) + min(counts) - 1
    found = missions_of(lines, [1] * len(lines), most)
    assert all(len(m.xyz) <= most for m in found)
    assert np.array_equal(np.concatenate([m.xyz for m in found]), np.concatenate([line.xyz for line in lines]))
    # a line that is too long for one file goes on where it was cut
    small = missions_of(lines[:1], [1], 3)
    assert len(small) == -(-(counts[0] - 1) // 2)
    for before, after in itertools.pairwise(small):
        assert np.array_equal(before.xyz[-1], after.xyz[0])
    with pytest.raises(InputError, match="more than 99"):
        missions_of(lines * 50, list(range(50 * len(lines))))


@pytest.mark.parametrize(
    ("change", "speed", "words"),
    [
        ({"wpml_payload": 0}, 3.0, "--wpml-payload"),
        ({"takeoff_height": ""}, 3.0, "needs --takeoff-height"),
        ({"takeoff_ellipsoid_height": ""}, 3.0, "needs --takeoff-ellipsoid-height"),
        ({"takeoff_height": "low"}, 3.0, "give a height in metres"),
        ({"takeoff_ellipsoid_height": "nan"}, 3.0, "give a height in metres"),
        ({}, 16.0, "at most 15 m/s"),
    ],
)
def test_what_a_mission_needs_is_asked_for(change: dict, speed: float, words: str) -> None:
    with pytest.raises(InputError, match=words) as refused:
        refuse_mission(replace(AIRCRAFT, **change), flight(flying_speed=speed))
    assert str(refused.value).endswith(".")
    refuse_mission(AIRCRAFT, flight())


def test_ways_between_lines_that_come_too_near_are_refused() -> None:
    """Two lines on both sides of a wall that neither passes: only a mission flies through it."""
    terrain = inclined(slope=0.0)
    heights = terrain.heights.copy()
    heights[58:62] += 60.0
    walled = replace(terrain, heights=heights, tops=heights)
    tracks = [np.array([[WEST + 20, NORTH + y], [WEST + 120, NORTH + y]]) for y in (-80.0, -30.0)]
    made = lines_along([tracks[0], tracks[1][::-1]], walled, flight(altitude=20.0))
    refuse_ways(made, terrain, flight(altitude=20.0))
    with pytest.raises(InputError, match=r"from line 1 to line 2 comes within 0\.0 m"):
        refuse_ways(made, walled, flight(altitude=20.0))


def test_heights_that_no_mission_can_have_are_refused(tmp_path: Path, lines: list[Line]) -> None:
    (mission,) = missions_of(lines, [1] * len(lines))
    far = replace(AIRCRAFT, takeoff_height="-900")
    high = replace(mission, xyz=mission.xyz + (0, 0, 600.0))
    with pytest.raises(InputError, match="check --takeoff-height"):
        write_mission(tmp_path / "m.kmz", high, CRS.from_user_input(CRS_CODE), far, flight())
    assert not list(tmp_path.iterdir())
