"""Points over a plane as a surface: a local linear regression at each node of a fine grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from .surface_kernels import half_gaussian, limits_of, smoothed_planes

NODE_M = 0.05
"""Distance of the grid's nodes."""
KERNEL_POINTS = 0.92
"""The kernel's standard deviation in mean distances of points (1 by the root of their density)."""
_TRUNCATE = 3.0  # standard deviations


@dataclass(frozen=True)
class GriddedSurface:
    """``values`` (3, rows, columns) at the nodes: height above the plane and its rise along the axes; NaN if unknown.

    ``corner`` (2,) is the plane's coordinates of node 0, 0; a row is a step along the first axis.
    """

    values: Float
    corner: Float


def kernel_of(density: float) -> float:
    """Standard deviation (m) of the kernel for so many points a m²."""
    return max(KERNEL_POINTS / float(np.sqrt(density)), NODE_M)


def gridded(points: Float, corner: Float, shape: tuple[int, int], kernel: float) -> GriddedSurface:
    """The surface of points (n, 3) in a plane's frame.

    Each node has the plane of least squares through the points around, weighted by a Gaussian of ``kernel`` metres.
    """
    place = (points[:, :2] - corner) / NODE_M
    index = np.rint(place).astype(np.int64)
    inside = ((index >= 0) & (index < shape)).all(axis=1)
    points, index, place = points[inside], index[inside], place[inside]
    middle = np.array(shape) / 2.0
    base = float(points[:, 2].mean()) if len(points) else 0.0
    x, y = np.ascontiguousarray((place - middle).T)
    key = index[:, 0] * shape[1] + index[:, 1]
    sigma = kernel / NODE_M
    half = half_gaussian(sigma, _TRUNCATE)
    values = smoothed_planes(key, x, y, points[:, 2] - base, shape, half, limits_of(sigma, base, NODE_M))
    return GriddedSurface(values, np.asarray(corner, dtype=np.float64))
