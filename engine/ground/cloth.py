"""Ground by the Cloth Simulation Filter, within limits on the cloth's size."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...interface.parameters import GroundParameters
from ..core.errors import InputError
from ..geometry.columns import greatest, least, spans
from .cloth_simulation import near_cloth

METHOD = "CSF"

MAX_CLOTH_PARTICLES = 16_000_000
"""Particles: the search for hanging ones takes 60 bytes for each."""
MAX_SEARCH_STEPS, MAX_BARE_PARTICLES = 1e8, 500
"""Steps of the search along rows, and particles in bare rows and columns: more take over ten seconds."""
_MAX_DISTANCE_CELLS = 3.0


def cloth_ground(
    xyz: NDArray[np.float64],
    parameters: GroundParameters,
    *,
    threshold: float | None = None,
    origin: NDArray[np.float64] | None = None,
) -> NDArray[np.bool_]:
    """Points within ``threshold`` of the settled cloth.

    Args:
        xyz: (n, 3) finite coordinates in metres.
        parameters: resolution, rigidness, time step, iterations and smoothing of the cloth.
        threshold: distance (m) to the cloth; ``parameters.class_threshold`` by default.
        origin: (2,) m, least coordinates of the cloud of which these points are a part: its particles lie as those of
            the whole cloud's cloth.

    Returns:
        (n,) bool. The same points give the same answer.

    Raises:
        InputError: a cloth too large, or coordinates that are not finite.
    """
    if len(xyz) == 0:
        return np.zeros(0, dtype=bool)
    low = least(xyz)
    if not np.isfinite(low).all() or not np.isfinite(greatest(xyz)).all():
        raise InputError("The cloud has coordinates that are not finite numbers; remove them before the ground filter.")
    refuse_large_cloth(xyz, parameters.cloth_resolution)
    # small coordinates keep the cloth's digits
    points = xyz - low
    added = [filling(points, parameters.cloth_resolution)]
    if origin is not None:
        added.append(_anchor(points, (origin - low[:2]) / parameters.cloth_resolution, parameters.cloth_resolution))
    near = near_cloth(
        np.vstack([points, *added]), parameters, parameters.class_threshold if threshold is None else threshold
    )
    return near[: len(xyz)]


def _anchor(points: NDArray[np.float64], steps: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
    """(1, 3) a point at the corner of points (n, 3), from where the particles are counted, as high as the nearest.

    Args:
        steps: (2,) where the whole cloud's particles begin, in particles from the points' lowest.
    """
    place = resolution * (steps - np.ceil(steps))
    nearest = np.argmin(np.abs(points[:, :2] - place).sum(axis=1))
    return np.array([[*place, points[nearest, 2]]])


def refuse_large_cloth(xyz: NDArray[np.float64], resolution: float) -> int:
    """Number of the cloth's particles over these points.

    Raises:
        InputError: more than MAX_CLOTH_PARTICLES, with a resolution that fits.
    """
    width, depth = spans(xyz[:, :2]).tolist()
    particles = math.floor(width / resolution + 4) * math.floor(depth / resolution + 4)
    if particles > MAX_CLOTH_PARTICLES:
        fits = math.ceil(100.0 * math.sqrt(width * depth / MAX_CLOTH_PARTICLES) * 1.05 + 1) / 100.0
        raise InputError(
            f"cloth_resolution is {resolution:g} m, which over {width:.0f} x {depth:.0f} m makes {particles:.2g} "
            f"particles; give at least {fits:g} m, or clip the cloud to a region of interest."
        )
    return particles


def filling(xyz: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
    """Points (m, 3) to add where much of the cloth has no point near it, as between two regions or next to a stray.

    For a particle without points the simulation walks along its row and column to the next one, and searches in all
    directions where both are empty, which takes hours on such a cloth. Particles far from any point get one, as low as
    the lowest at the nearest particle that has some. Empty for an ordinary cloud.
    """
    index = np.floor((xyz[:, :2] - least(xyz[:, :2])) / resolution + 0.5).astype(np.int64)
    shape = tuple(int(n) + 1 for n in greatest(index))
    bare = math.prod(n - len(np.unique(index[:, axis])) for axis, n in enumerate(shape))
    if bare <= MAX_BARE_PARTICLES and math.prod(shape) * max(shape) <= MAX_SEARCH_STEPS:
        return np.empty((0, 3))
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest, (index[:, 0], index[:, 1]), xyz[:, 2])
    distance, (i, j) = ndimage.distance_transform_edt(np.isinf(lowest), return_indices=True)
    far = np.nonzero(distance > _MAX_DISTANCE_CELLS)
    if bare <= MAX_BARE_PARTICLES and len(far[0]) * max(shape) <= MAX_SEARCH_STEPS:
        return np.empty((0, 3))
    place = least(xyz[:, :2]) + resolution * np.column_stack(far)
    return np.column_stack([place, lowest[i[far], j[far]]])
