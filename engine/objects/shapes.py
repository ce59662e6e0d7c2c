"""The shape of a group of returns: sides, height, volume, and whether it is one closed surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import Delaunay, QhullError
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Float
from .base import NEIGHBOURS
from .evidence import top_of

_MIN_FITTED = 9


@dataclass(frozen=True)
class Shape:
    """Metres and m³. ``height`` is that of the top over the ground, ``lowest`` of the lowest return.

    ``volume_error`` is the standard error of ``volume``.

    ``misfit`` is the scatter (m) of the returns about one surface of the second order, NaN for too few.
    """

    length: float
    width: float
    height: float
    lowest: float
    volume: float
    volume_error: float
    misfit: float


def shape_of(xyz: Float, height: Float, around: tuple[Float, Float], area: BaseGeometry) -> Shape:
    """Of returns (n, 3) with their heights (n,) over the ground, m, with a footprint.

    Args:
        around: returns (m, 3) of the same survey from the ground around, and their heights (m,).
    """
    length, width = sides(area)
    volume, error = _volume(xyz, height, around)
    return Shape(
        length=length,
        width=width,
        height=top_of(height),
        lowest=float(height.min()),
        volume=volume,
        volume_error=error,
        misfit=_misfit(xyz),
    )


def sides(area: BaseGeometry) -> tuple[float, float]:
    """Length and width (m) of the smallest rectangle around an area."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
    if len(corners) < 4:
        return 0.0, 0.0
    first, second = np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)
    return float(max(first, second)), float(min(first, second))


def _volume(xyz: Float, height: Float, around: tuple[Float, Float]) -> tuple[float, float]:
    """m³ below triangles of the returns on the object and of those around, and its standard error.

    An edge lies anywhere between the last return on the object and the first one beside it, so a triangle between the
    two holds between nothing and twice its volume. Triangles of one side err alike, as where vegetation hides it;
    two sides at least err apart.
    """
    xy, heights = np.concatenate([xyz[:, :2], around[0][:, :2]]), np.concatenate([height, around[1]])
    try:
        corners = Delaunay(xy - xy.mean(axis=0)).simplices
    except QhullError:  # points on a line
        return 0.0, float("nan")
    on = (corners < len(xyz)).sum(axis=1)
    corners, on = corners[on > 0], on[on > 0]
    along, across = (xy[corners[:, k]] - xy[corners[:, 0]] for k in (1, 2))
    areas = np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]) / 2
    parts = areas * heights[corners].mean(axis=1)
    edge = parts[on < 3]
    ground = float(np.std(around[1])) / np.sqrt(min(len(around[1]), NEIGHBOURS)) if len(around[1]) else 0.0
    return float(parts.sum()), float(np.hypot(edge.sum() / np.sqrt(6.0), ground * areas.sum()))


def _misfit(xyz: Float) -> float:
    if len(xyz) < _MIN_FITTED:
        return float("nan")
    x, y, z = (xyz - xyz.mean(axis=0)).T
    design = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    rest = z - design @ np.linalg.lstsq(design, z, rcond=None)[0]
    return float(np.sqrt((rest**2).sum() / (len(x) - design.shape[1])))
