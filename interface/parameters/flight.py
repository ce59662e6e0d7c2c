"""Parameters of a planned flight."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import AUTO, ParameterSet, _parameter


@dataclass(frozen=True)
class FlightParameters(ParameterSet, record_name="flight"):
    """How a survey is flown, and what is expected of it."""

    altitude: float = _parameter(
        40.0,
        "Altitude over the ground",
        "Least height of the lines over the ground below them. Larger needs fewer lines and gives fewer returns.",
        unit="m",
        bounds=(5.0, 1000.0),
    )
    flying_speed: float = _parameter(
        3.0,
        "Flying speed",
        "Speed along the lines. Larger takes less time and gives fewer returns.",
        unit="m/s",
        bounds=(0.2, 60.0),
    )
    field_of_view: float = _parameter(
        70.0,
        "Field of view",
        "Angle of the scanner's strip, from edge to edge across the flight. Larger needs fewer lines.",
        unit="degrees",
        bounds=(5.0, 150.0),
    )
    side_overlap: float = _parameter(
        0.5,
        "Side overlap",
        "Share of a strip on flat ground that the next one covers as well. Larger gives more lines and more returns.",
        bounds=(0.0, 0.95),
    )
    pulse_rate: float = _parameter(
        240000.0,
        "Pulse rate",
        "Pulses a second that leave the scanner within the field of view. Larger gives more returns.",
        unit="Hz",
        bounds=(10.0, 10000000.0),
    )
    scan_pattern: str = _parameter(
        "line",
        "Scan pattern",
        "How the pulses lie in the field of view. line: across the flight, alike over the angle, as of a turning "
        "mirror. disc: alike over a cone around the vertical. rosette: over a cone, as of the simulated surveys.",
        choices=("line", "disc", "rosette"),
    )
    azimuth: float | str = _parameter(
        AUTO,
        "Azimuth of the lines",
        "Direction of the lines, clockwise from north. auto: along the contour of the region's mean plane.",
        kind=float,
        unit="degrees",
        bounds=(0.0, 360.0),
    )
    margin: float = _parameter(
        5.0,
        "Margin",
        "How far the lines reach beyond the region, along and across. Larger sees its edges better and takes longer.",
        unit="m",
        bounds=(0.0, 500.0),
    )
    climb_rate: float = _parameter(
        2.0,
        "Climb rate",
        "How fast the carrier may climb and sink on a line. Smaller flies smoother and higher over hollows.",
        unit="m/s",
        bounds=(0.05, 30.0),
        advanced=True,
    )
    height_tolerance: float = _parameter(
        0.5,
        "Height tolerance",
        "By how much heights between waypoints may differ from the ground's course. Larger makes fewer waypoints.",
        unit="m",
        bounds=(0.05, 50.0),
        advanced=True,
    )
    clearance: float = _parameter(
        10.0,
        "Clearance",
        "Least distance of a line to ground and known plants, in any direction. A plan that comes nearer is refused; "
        "larger refuses more.",
        unit="m",
        bounds=(0.0, 500.0),
    )
    bridged_terrain: float = _parameter(
        10.0,
        "Bridged terrain",
        "Gaps of the terrain, and ground beyond its edge, up to so far from what is known get heights of the ground "
        "around. Larger flies over ground that nobody has measured.",
        unit="m",
        bounds=(0.0, 200.0),
        advanced=True,
    )
    turn_time: float = _parameter(
        6.0,
        "Time of a turn",
        "Braking, turning and getting up to speed between two lines, in addition to the way. Larger lengthens the "
        "flight.",
        unit="s",
        bounds=(0.0, 600.0),
        advanced=True,
    )
    battery_time: float = _parameter(
        20.0,
        "Time of a battery",
        "How long a battery carries the scanner over the lines, the ways there and back and the reserve not counted. "
        "Larger needs fewer batteries.",
        unit="min",
        bounds=(1.0, 600.0),
    )
    ground_share: float | str = _parameter(
        AUTO,
        "Share of pulses that reach the ground",
        "Of all pulses, those with a return of the ground. Larger promises more ground. auto: as the last survey shows "
        "it place by place, and 1, bare ground, without one.",
        kind=float,
        bounds=(0.001, 1.0),
    )
    ground_scatter: float | str = _parameter(
        AUTO,
        "Scatter of ground returns",
        "Standard deviation of the heights of ground returns about a plane through a few of them, by roughness and "
        "noise. Larger promises a larger level of detection. auto: as the last survey's ground shows it by the size of "
        "the cell, and 0.03 m without one.",
        kind=float,
        unit="m",
        bounds=(0.001, 5.0),
    )
    expected_registration_error: float = _parameter(
        0.005,
        "Registration error",
        "Standard error in height of the registration of two such surveys. Larger promises a larger level of "
        "detection.",
        unit="m",
        bounds=(0.0, 1.0),
        advanced=True,
    )
    expected_confidence: float = _parameter(
        0.95,
        "Confidence of the level of detection",
        "Probability that unchanged ground stays below the expected level. Larger promises a larger level.",
        bounds=(0.5, 0.9999),
        advanced=True,
    )
    motion_window: float = _parameter(
        5.0,
        "Window of motion",
        "Width of the windows in which motion along the surface would be looked for. Larger finds smaller motion.",
        unit="m",
        bounds=(1.0, 100.0),
        advanced=True,
    )
    place_size: float = _parameter(
        2.0,
        "Size of a place",
        "Side of the squares for which density, level and motion are given. Larger is coarser and quicker.",
        unit="m",
        bounds=(0.5, 100.0),
    )
