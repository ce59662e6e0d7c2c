"""Points over a plane as a surface: a local linear regression at each node of a fine grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Float
from ..geometry.plane_kernels import product_sums

NODE_M = 0.05
"""Distance of the grid's nodes."""
KERNEL_POINTS = 0.92
"""The kernel's standard deviation in mean distances of points (1 by the root of their density)."""
_TRUNCATE = 3.0  # standard deviations
_MIN_WEIGHT = 1.5  # sum of the kernel's weights (1 in its middle); on average it is 5.3
_MAX_OFF_CENTRE = 0.8  # kernel's standard deviations from a node to the mean of its points
_MIN_SPREAD = 0.15  # share of the kernel's variance that the points have in their narrowest direction


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
    sums = product_sums(key, x, y, points[:, 2] - base, np.ones(len(points)), shape[0] * shape[1]).reshape(9, *shape)
    sigma = kernel / NODE_M
    scale = 2 * np.pi * sigma**2  # weights of 1 in the middle
    sums = np.stack([ndimage.gaussian_filter(s, sigma, mode="constant", truncate=_TRUNCATE) for s in sums]) * scale
    u = (np.arange(shape[0]) - middle[0])[:, None]
    v = (np.arange(shape[1]) - middle[1])[None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        w, sx, sy, sxx, sxy, syy, sz, sxz, syz = sums
        mx, my, mz = sx / w, sy / w, sz / w
        cxx, cxy, cyy = sxx / w - mx * mx, sxy / w - mx * my, syy / w - my * my
        cxz, cyz = sxz / w - mx * mz, syz / w - my * mz
        determinant = cxx * cyy - cxy * cxy
        along, across = (cyy * cxz - cxy * cyz) / determinant, (cxx * cyz - cxy * cxz) / determinant
        off = (mx - u) ** 2 + (my - v) ** 2
        narrowest = (cxx + cyy) / 2 - np.sqrt(np.maximum(((cxx - cyy) / 2) ** 2 + cxy**2, 0.0))
        known = (w >= _MIN_WEIGHT) & (off <= (_MAX_OFF_CENTRE * sigma) ** 2) & (narrowest >= _MIN_SPREAD * sigma**2)
        height = mz + along * (u - mx) + across * (v - my) + base
    values = np.stack([height, along / NODE_M, across / NODE_M])
    values[:, ~known] = np.nan
    return GriddedSurface(values, np.asarray(corner, dtype=np.float64))
