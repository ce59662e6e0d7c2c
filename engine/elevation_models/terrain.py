"""What the terrain of an elevation model is like in each cell: the attributes that its errors follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Float


@dataclass(frozen=True)
class Terrain:
    """Attributes (rows, columns) of a surface; NaN where a neighbour is not known.

    Attributes:
        east, north: rise of the surface, metres a metre.
        slope: degrees.
        curvature: the larger magnitude of profile and plan curvature, 1/m.
        roughness: root mean square of the nine cells about the plane through them, metres.
    """

    east: Float
    north: Float
    slope: Float
    curvature: Float
    roughness: Float


def terrain_of(heights: Float, cell: float) -> Terrain:
    """Slope after Horn (1981, doi:10.1109/PROC.1981.11918), maximum curvature after Zevenbergen and Thorne (1987,
    doi:10.1002/esp.3290120107), and roughness, from the eight neighbours of each cell.

    Args:
        heights: (rows, columns), metres, NaN where unknown.
        cell: side of a cell, metres.
    """
    east, north = gradients(heights, cell)
    return Terrain(
        east,
        north,
        np.degrees(np.arctan(np.hypot(east, north))),
        _maximum_curvature(heights, cell),
        _roughness(heights, east, north, cell),
    )


def gradients(heights: Float, cell: float) -> tuple[Float, Float]:
    """Eastward and northward rise (rows, columns), metres a metre: Horn's weights; NaN beside gaps and at the edge."""
    smooth, rise = np.array([1.0, 2.0, 1.0]) / 4.0, np.array([-1.0, 0.0, 1.0]) / (2.0 * cell)

    def along(axis: int) -> Float:
        once = ndimage.correlate1d(heights, rise, axis=axis, mode="constant", cval=np.nan)
        found: Float = ndimage.correlate1d(once, smooth, axis=1 - axis, mode="constant", cval=np.nan)
        return found

    return along(1), -along(0)


def _maximum_curvature(heights: Float, cell: float) -> Float:
    """Of the quadratic through the four neighbours and the corners, per metre."""

    def second(axis: int) -> Float:
        found: Float = ndimage.correlate1d(heights, [1.0, -2.0, 1.0], axis=axis, mode="constant", cval=np.nan)
        return found / cell**2

    def first(axis: int) -> Float:
        found: Float = ndimage.correlate1d(heights, [-1.0, 0.0, 1.0], axis=axis, mode="constant", cval=np.nan)
        return found / (2.0 * cell)

    xx, yy = second(1), second(0)
    x, y = first(1), first(0)
    mixed = ndimage.correlate1d(heights, [-1.0, 0.0, 1.0], axis=1, mode="constant", cval=np.nan)
    xy = ndimage.correlate1d(mixed, [-1.0, 0.0, 1.0], axis=0, mode="constant", cval=np.nan) / (4.0 * cell**2)
    squares = x**2 + y**2
    with np.errstate(invalid="ignore", divide="ignore"):
        profile = (xx * x**2 + 2.0 * xy * x * y + yy * y**2) / squares
        plan = (xx * y**2 - 2.0 * xy * x * y + yy * x**2) / squares
    # level ground has no direction: the larger of the two along the axes
    level = squares < 1e-12
    profile, plan = np.where(level, xx, profile), np.where(level, yy, plan)
    return np.maximum(np.abs(profile), np.abs(plan))


def _roughness(heights: Float, east: Float, north: Float, cell: float) -> Float:
    """The plane is the mean of the nine with Horn's rise."""
    total = np.zeros(heights.shape)
    filled = np.where(np.isfinite(heights), heights, 0.0)
    middle = ndimage.uniform_filter(filled, 3, mode="nearest")
    padded = np.pad(heights, 1, constant_values=np.nan)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            rows = slice(1 + down, 1 + down + heights.shape[0])
            columns = slice(1 + right, 1 + right + heights.shape[1])
            plane = middle + (right * east - down * north) * cell
            total += (padded[rows, columns] - plane) ** 2
    return np.sqrt(total / 9.0)
