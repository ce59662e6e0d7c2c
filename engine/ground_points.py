"""Ground among points in memory: the steps of the extraction that need no files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .csf import cloth_ground
from .denoise import outliers
from .errors import InputError
from .ground_surface import ground_near_surface
from .parameters import GroundParameters
from .plane import Plane, apply_matrix, fit_plane, flattening_matrix, lowest_points

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]
PLANE_CELL, PLANE_DISTANCE, PLANE_TRIES, PLANE_SEED = 1.0, 0.3, 500, 1
FEWEST_POINTS = 10


@dataclass(frozen=True)
class Filtered:
    """``ground`` (n,) bool, and the scatter and threshold of the refinement."""

    ground: Bool
    scatter: float
    threshold: float


def ground_mask(xyz: Float, parameters: GroundParameters | None = None, last: Bool | None = None) -> Bool:
    """Ground among points (n, 3) in metres, by the CSF authors' library.

    Args:
        last: (n,) which points are last returns; all where unknown.

    Returns:
        (n,) bool; points that are not finite are not ground.

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
    kept = (
        ~outliers(flat, parameters.denoise_radius, parameters.denoise_group)
        if parameters.denoise
        else np.ones(len(points), dtype=bool)
    )
    if last is not None and parameters.last_returns:
        kept &= last[finite]
    index = np.flatnonzero(finite)[kept]
    frame = flat[kept] if parameters.slope_aligned else points[kept]
    near = cloth_ground(frame, parameters, threshold=cloth_threshold(parameters))
    ground[index] = refined(flat[kept], near, parameters).ground
    return ground


def dominant_plane(xyz: Float) -> Plane:
    """The slope's plane from the lowest points of cells, which plants and outliers sway least."""
    low = lowest_points(xyz, PLANE_CELL)
    return fit_plane(low if len(low) >= 30 else xyz, PLANE_DISTANCE, PLANE_TRIES, PLANE_SEED)


def refined(flat: Float, near: Bool, parameters: GroundParameters) -> Filtered:
    """Ground among points in the slope's frame of which the cloth found some ``near``."""
    if not parameters.refine:
        return Filtered(near, 0.0, parameters.class_threshold)
    surface = ground_near_surface(flat[near], parameters.class_threshold)
    ground = np.zeros(len(flat), dtype=bool)
    ground[np.flatnonzero(near)[surface.ground]] = True
    return Filtered(ground, surface.scatter, surface.threshold)


def cloth_threshold(parameters: GroundParameters) -> float:
    """Distance to the cloth (m) within which points are looked at further."""
    return parameters.cloth_reach if parameters.refine else parameters.class_threshold


def require_points(what: str, count: int) -> None:
    """Raise InputError if there are too few points to work with."""
    if count < FEWEST_POINTS:
        raise InputError(f"{what} holds {count} points, too few to find ground in; give a larger cloud or region.")
