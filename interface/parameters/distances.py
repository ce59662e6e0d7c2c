"""Parameters of distances along normals (M3C2)."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class DistanceParameters(ParameterSet):
    """Distances of two clouds along the surface's normal: M3C2 (Lague et al. 2013).

    It has a command of its own, so that ``confidence`` and ``registration_error`` are named as in ``ChangeParameters``.
    """

    normal_scale: float = _parameter(
        0.0,
        "Normal scale",
        "Diameter of the ball whose points give the normal. Larger is steadier and smooths relief. 0: 25 times the "
        "roughness, from the reference.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    projection_scale: float = _parameter(
        0.0,
        "Projection scale",
        "Diameter of the cylinder that gathers the points of both surveys. Larger is surer and blurs. 0: so that it "
        "holds about 25 points of the sparser survey.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    half_length: float = _parameter(
        0.0,
        "Half length of the cylinder",
        "The cylinder reaches so far to both sides of the surface. Change beyond it is not seen; too long a cylinder "
        "meets other surfaces. 0: twice as far as the surveys are apart.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    core_spacing: float = _parameter(
        0.0,
        "Spacing of the core points",
        "One point of the reference in each cube of this size is measured. Smaller shows more and takes longer. 0: "
        "about half the projection scale. Has no effect where core points are given.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    distance_cell: float = _parameter(
        0.0,
        "Cell of the rasters",
        "Side of a cell, which holds the mean of its core points. Smaller leaves gaps. 0: the spacing of the core "
        "points.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
        advanced=True,
    )
    normals: str = _parameter(
        "fitted",
        "Normals",
        "Direction of measuring. fitted: square to the surface of the reference. given: the dimensions NormalX, "
        "NormalY and NormalZ of the core points. vertical: straight up, as a difference of heights.",
        choices=("fitted", "given", "vertical"),
        advanced=True,
    )
    orientation: str = _parameter(
        "0,0,1",
        "Side of the normals",
        "Fitted normals point to the side of this direction (x,y,z), which counts as raising. 0,0,1: upwards, right "
        "for all but overhanging faces.",
        advanced=True,
    )
    minimum_cylinder_points: int = _parameter(
        5,
        "Least points in a cylinder",
        "With fewer points of either survey no level of detection is told and nothing is significant. Larger is surer.",
        minimum=2,
        maximum=100000,
        advanced=True,
    )
    confidence: float = _parameter(
        0.95,
        "Confidence of the level of detection",
        "Probability with which unchanged ground stays below the level. Larger reports less and surer change.",
        minimum=0.5,
        maximum=0.9999,
    )
    registration_error: float = _parameter(
        -1.0,
        "Registration error",
        "Standard error of the registration, which enters the level of detection. -1: as the transform tells, else 0. "
        "Larger widens the level.",
        unit="m",
        minimum=-1.0,
        maximum=10.0,
    )
    calibrate: bool = _parameter(
        True,
        "Calibrate errors on stable ground",
        "Sums the errors in squares and scales them, by slope, so that unchanged ground stays below its level of "
        "detection as often as the confidence says. Off: the level as Lague et al. (2013) published it, which adds the "
        "registration error to that of the points and is wider or narrower than it says.",
    )
