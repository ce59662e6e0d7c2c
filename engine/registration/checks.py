"""What the points of two epochs must be to be registered."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Float
from ..core.errors import InputError

_MIN_POINTS = 30


def check_points(xyz: Float, name: str) -> None:
    """Raise InputError unless ``xyz`` (n, 3) holds enough points, all finite; ``name`` is the epoch's in words."""
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise InputError(f"The {name} epoch's points have the shape {xyz.shape}; give x, y and z of each.")
    if len(xyz) < _MIN_POINTS:
        raise InputError(
            f"The {name} epoch has {len(xyz)} points and registration needs at least {_MIN_POINTS}; "
            "check the region and the ground extraction."
        )
    # a sum is finite only if all its terms are, and needs no second copy of the cloud
    if not np.isfinite(xyz.sum()):
        bad = int(np.count_nonzero(~np.isfinite(xyz).all(axis=1)))
        raise InputError(f"The {name} epoch has {bad} points whose coordinates are not finite; remove them.")


def check_overlap(reference: Float, moving: Float, offset: float) -> None:
    """Raise InputError if the extents lie more than ``offset`` metres apart."""
    boxes = [(xyz.min(axis=0), xyz.max(axis=0)) for xyz in (reference, moving)]
    gap = np.maximum(boxes[0][0] - boxes[1][1], boxes[1][0] - boxes[0][1])
    if (gap > offset).any():
        first, second = (
            " to ".join("(" + ", ".join(f"{v:.1f}" for v in corner) + ")" for corner in box) for box in boxes
        )
        raise InputError(
            f"The epochs do not overlap: the earlier extends over {first}, the later over {second}; check the files, "
            f"their reference systems and units, or raise the largest expected offset ({offset:g} m)."
        )


def check_shape(points: Float, name: str) -> None:
    """Raise InputError unless voxel means (n, 3) are enough and no line."""
    if len(points) < _MIN_POINTS:
        raise InputError(f"The {name} epoch has only {len(points)} occupied voxels; give a smaller registration voxel.")
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    core = np.clip(points, low, high)
    spread = np.linalg.svd(core - core.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        raise InputError(
            f"The {name} epoch's points lie on one line, which fixes no registration; check the region of interest."
        )


def inside(area: BaseGeometry | None, xyz: Float) -> NDArray[np.bool_] | None:
    """Which points (n, 3) lie in a stable area, None without one; raises InputError if there are too few."""
    if area is None:
        return None
    shapely.prepare(area)
    found: NDArray[np.bool_] = shapely.contains_xy(area, xyz[:, 0], xyz[:, 1])
    if np.count_nonzero(found) < _MIN_POINTS:
        raise InputError(
            f"The stable area holds {np.count_nonzero(found)} points of the earlier epoch and registration needs at "
            f"least {_MIN_POINTS}; draw it on ground that was surveyed, or register without it."
        )
    return found
