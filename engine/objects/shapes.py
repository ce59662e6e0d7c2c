"""The shape of a group of returns: sides, height, volume, and whether it is one closed surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Float

_MIN_FITTED = 9


@dataclass(frozen=True)
class Shape:
    """Metres and m³. ``height`` is that of the top over the ground, ``lowest`` of the lowest return.

    ``misfit`` is the scatter (m) of the returns about one surface of the second order, NaN for too few.
    """

    length: float
    width: float
    height: float
    lowest: float
    volume: float
    misfit: float


def shape_of(xyz: Float, height: Float, area: BaseGeometry) -> Shape:
    """Of returns (n, 3) with their heights (n,) over the ground, m, over a footprint."""
    length, width = sides(area)
    return Shape(
        length=length,
        width=width,
        height=float(np.quantile(height, 0.95)) if len(height) >= 20 else float(height.max()),
        lowest=float(height.min()),
        volume=float(area.area * _mean_top(xyz, height, area)),
        misfit=_misfit(xyz),
    )


def sides(area: BaseGeometry) -> tuple[float, float]:
    """Length and width (m) of the smallest rectangle around an area."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
    if len(corners) < 4:
        return 0.0, 0.0
    first, second = np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)
    return float(max(first, second)), float(min(first, second))


def _mean_top(xyz: Float, height: Float, area: BaseGeometry) -> float:
    """Mean height (m) of the highest of the returns near places all over the footprint."""
    west, south, east, north = area.bounds
    step = max(float(np.sqrt(area.area / 400.0)), 0.05)
    places = np.stack(np.meshgrid(np.arange(west + step / 2, east, step), np.arange(south + step / 2, north, step)), -1)
    places = places.reshape(-1, 2)
    places = places[shapely.contains_xy(area, *places.T)] if len(places) else places
    if not len(places):
        return float(np.mean(height))
    near = cKDTree(xyz[:, :2]).query(places, k=1)[1]
    return float(np.mean(height[near]))


def _misfit(xyz: Float) -> float:
    if len(xyz) < _MIN_FITTED:
        return float("nan")
    x, y, z = (xyz - xyz.mean(axis=0)).T
    design = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    rest = z - design @ np.linalg.lstsq(design, z, rcond=None)[0]
    return float(np.sqrt((rest**2).sum() / (len(x) - design.shape[1])))
