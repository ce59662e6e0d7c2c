"""Ground among points in memory: the steps of the extraction that need no files."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...interface.parameters import GroundParameters
from ..core.arrays import Bool, Float
from ..core.errors import InputError
from ..geometry.dominant_plane import Plane, apply_matrix, fit_plane, flattening_matrix, lowest_points
from ..pointcloud.plant_cover import PlantCover
from .cloth import cloth_ground
from .layered_ground import layered_ground
from .outliers import outliers

PLANE_CELL, PLANE_TRIES, PLANE_SEED = 1.0, 500, 1
PLANE_DISTANCES = (0.3, 0.6, 1.2, 2.4, 4.8)
MIN_PLANE_SHARE, MIN_PLANE_POINTS = 0.5, 30
MIN_POINTS = 10
MIN_DIP_COSINE = 0.1


@dataclass(frozen=True)
class Filtered:
    """``ground`` (n,) bool, and the scatter and threshold of the refinement, metres.

    ``height``, ``plant_error`` and ``plant_height`` (n,) are those of ``layered_ground.LayeredGround``; None without
    the refinement.
    """

    ground: Bool
    scatter: float
    threshold: float
    height: Float | None = None
    plant_error: Float | None = None
    plant_height: Float | None = None


@dataclass(frozen=True)
class KnownGround:
    """``mask`` (n,): which points are ground; ``plants`` over those, vertical metres, None without the refinement."""

    mask: Bool
    plants: PlantCover | None


def ground_mask(xyz: Float, parameters: GroundParameters | None = None, last: Bool | None = None) -> Bool:
    """Ground among points (n, 3) in metres: the mask (n,) of ``known_ground``, which see."""
    return known_ground(xyz, parameters, last).mask


def known_ground(xyz: Float, parameters: GroundParameters | None = None, last: Bool | None = None) -> KnownGround:
    """Ground among points (n, 3) in metres and the plants over it by our own cloth simulation.

    Points that are not finite are not ground.

    Args:
        last: (n,) which points are last returns; all where unknown.

    Raises:
        InputError: too few points, all on a line, or more than 0.1 % that are not finite.
    """
    parameters = parameters or GroundParameters()
    finite = np.isfinite(xyz).all(axis=1)
    if len(xyz) - np.count_nonzero(finite) > 0.001 * len(xyz):
        raise InputError(
            f"{len(xyz) - np.count_nonzero(finite)} of {len(xyz)} points have coordinates that are not finite numbers; "
            "export the cloud again."
        )
    ground = np.zeros(len(xyz), dtype=bool)
    points = xyz[finite]
    require_points("the cloud", len(points))
    plane = dominant_plane(points)
    flat = apply_matrix(flattening_matrix(plane), points)
    kept = np.ones(len(points), dtype=bool)
    if parameters.denoise:
        kept = ~outliers(flat, parameters.denoise_radius, parameters.denoise_group)
    flat, points = flat[kept], points[kept]
    taken = np.ones(len(points), dtype=bool)
    if last is not None and parameters.last_returns:
        taken = last[finite][kept]
    near = np.zeros(len(points), dtype=bool)
    frame = flat if parameters.slope_aligned else points
    near[taken] = cloth_ground(frame[taken], parameters, threshold=cloth_threshold(parameters))
    found = refined(flat, near, taken, parameters)
    ground[np.flatnonzero(finite)[kept]] = found.ground
    if found.plant_error is None or found.plant_height is None:
        return KnownGround(ground, None)
    upright = vertical(plane.dip)
    error, height = (values[found.ground] * upright for values in (found.plant_error, found.plant_height))
    return KnownGround(ground, PlantCover(error, height))


def vertical(dip: float) -> float:
    """Vertical metres to a metre square to a plane of the inclination ``dip``, degrees."""
    return 1.0 / max(math.cos(math.radians(dip)), MIN_DIP_COSINE)


def dominant_plane(xyz: Float) -> Plane:
    """The slope's plane from the lowest points of cells, which plants and outliers sway least.

    A rough or curved slope has no plane that many points lie on closely, so the distance widens until half of them do.
    """
    low = lowest_points(xyz, PLANE_CELL)
    return plane_through(low if len(low) >= MIN_PLANE_POINTS else xyz)


def plane_through(points: Float) -> Plane:
    """The slope's plane through points (n, 3) that are mostly ground, see ``dominant_plane``."""
    for distance in PLANE_DISTANCES:
        plane = fit_plane(points, distance, PLANE_TRIES, PLANE_SEED)
        if plane.inlier_share >= MIN_PLANE_SHARE:
            break
    return plane


def refined(flat: Float, near: Bool, taken: Bool, parameters: GroundParameters) -> Filtered:
    """Ground among points (n, 3) in the slope's frame.

    Args:
        near: (n,) which points the cloth found.
        taken: (n,) which points may be ground.
    """
    if not parameters.refine:
        return Filtered(near & taken, 0.0, parameters.class_threshold)
    found = layered_ground(flat, near, taken, parameters.class_threshold)
    return Filtered(found.ground, found.scatter, found.threshold, found.height, found.plant_error, found.plant_height)


def cloth_threshold(parameters: GroundParameters) -> float:
    """Distance to the cloth (m) within which points are looked at further."""
    return parameters.cloth_reach if parameters.refine else parameters.class_threshold


def require_points(what: str, count: int) -> None:
    """Raise InputError if there are too few points to work with."""
    if count < MIN_POINTS:
        raise InputError(f"{what} holds {count} points, too few to find ground in; give a larger cloud or region.")
