"""Parameters of mission files, which an aircraft flies by itself."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter

_MAX_NUMBER = 1_000_000


@dataclass(frozen=True)
class MissionParameters(ParameterSet, record_name="mission", title="Mission files of DJI"):
    """What a mission file for an aircraft of DJI says of it; heights in it are above the take-off point."""

    wpml_drone: int = _parameter(
        0,
        "Number of the aircraft",
        "Of DJI's tables: 60 is the M300 RTK, 89 the M350 RTK. 0: no mission file is written.",
        bounds=(0, _MAX_NUMBER),
        advanced=True,
    )
    wpml_payload: int = _parameter(
        0,
        "Number of the payload",
        "Of DJI's tables, or as a mission that the remote controller exported has it (payloadEnumValue): 65534 is a "
        "payload made with the Payload SDK. 0: not known, and no mission file is written.",
        bounds=(0, _MAX_NUMBER),
        advanced=True,
    )
    wpml_payload_position: int = _parameter(
        0,
        "Place of the payload",
        "0: the main gimbal, which is the front left one of M300 and M350; 1: the front right one; 2: on top.",
        bounds=(0, 2),
        advanced=True,
    )
    takeoff_height: str = _parameter(
        "",
        "Height of the take-off point",
        "In metres, as the terrain counts heights. A mission flies heights above the take-off point: if you take off "
        "higher or lower, all lines are higher or lower by as much. Empty: not known, and no mission file is written.",
        advanced=True,
    )
    takeoff_ellipsoid_height: str = _parameter(
        "",
        "Ellipsoidal height of the take-off point",
        "In metres above the ellipsoid of WGS 84, as the remote controller shows it; a mission file states it of each "
        "waypoint. Empty: not known, and no mission file is written.",
        advanced=True,
    )
