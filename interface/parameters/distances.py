"""Parameters of distances along normals (M3C2)."""

from __future__ import annotations

from dataclasses import dataclass

from .memory import memory_for_points
from .specification import AUTO, ParameterSet, _parameter


@dataclass(frozen=True)
class DistanceParameters(ParameterSet, record_name="distances"):
    """Distances of two clouds along the surface's normal: M3C2 (Lague et al. 2013).

    It has a command of its own, so that ``confidence`` and ``registration_error`` are named as in ``ChangeParameters``.
    """

    normal_scale: float | str = _parameter(
        AUTO,
        "Normal scale",
        "Diameter of the ball whose points give the normal. Larger is more stable and smooths relief. auto: 25 times "
        "the roughness of the reference.",
        kind=float,
        unit="m",
        bounds=(0.001, 1000.0),
    )
    projection_scale: float | str = _parameter(
        AUTO,
        "Projection scale",
        "Diameter of the cylinder that gathers the points of both surveys. Larger is less noisy and blurs. auto: so "
        "that it holds about 25 points of the sparser survey.",
        kind=float,
        unit="m",
        bounds=(0.001, 1000.0),
    )
    half_length: float | str = _parameter(
        AUTO,
        "Half length of the cylinder",
        "The cylinder reaches this far on both sides of the surface. Change beyond it is not detected; too long a "
        "cylinder meets other surfaces. auto: twice the distance between the surveys.",
        kind=float,
        unit="m",
        bounds=(0.001, 1000.0),
    )
    core_spacing: float | str = _parameter(
        AUTO,
        "Spacing of the core points",
        "One point of the reference in each cube of this size is measured. Smaller shows more and takes longer. auto: "
        "about half the projection scale. Has no effect where core points are given.",
        kind=float,
        unit="m",
        bounds=(0.001, 1000.0),
    )
    distance_cell: float | str = _parameter(
        AUTO,
        "Cell of the rasters",
        "Side of a cell, which holds the mean of its core points. Smaller leaves gaps. auto: the spacing of the core "
        "points.",
        kind=float,
        unit="m",
        bounds=(0.001, 1000.0),
        advanced=True,
    )
    normals: str = _parameter(
        "fitted",
        "Normals",
        "Direction of measurement. fitted: perpendicular to the surface of the reference. given: the dimensions "
        "NormalX, NormalY and NormalZ of the core points. vertical: upwards, as a difference of heights.",
        choices=("fitted", "given", "vertical"),
        advanced=True,
    )
    orientation: str = _parameter(
        "0,0,1",
        "Side of the normals",
        "Fitted normals point to the side of this direction (x,y,z), which counts as raising. 0,0,1: upwards, suitable "
        "for all faces that do not overhang.",
        advanced=True,
    )
    minimum_cylinder_points: int = _parameter(
        5,
        "Minimum points in a cylinder",
        "With fewer points of either survey there is no level of detection and nothing is significant. Larger is more "
        "reliable.",
        bounds=(2, 100000),
        advanced=True,
    )
    confidence: float = _parameter(
        0.95,
        "Confidence of the level of detection",
        "Probability that unchanged ground stays below the level. Larger reports less change, and more reliably.",
        bounds=(0.5, 0.9999),
    )
    registration_error: float | str = _parameter(
        AUTO,
        "Registration error",
        "Standard error of the registration, which enters the level of detection. Larger widens the level. auto: as "
        "the transform states it, else 0.",
        kind=float,
        unit="m",
        bounds=(0.0, 10.0),
    )
    calibrate: bool = _parameter(
        True,
        "Calibrate errors on stable ground",
        "Adds the errors in quadrature and scales them, by slope, so that unchanged ground stays below its level of "
        "detection as often as the confidence says. Off: the level as Lague et al. (2013) published it, which adds the "
        "registration error to that of the points and is wider or narrower than it says.",
    )
    memory_limit: float | str = memory_for_points()
