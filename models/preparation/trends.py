"""Heights over robust trends of the slope: what a bulge or a hollow adds to the ground around it.

On a raster of median heights a plane is fitted about every cell, weighted by a Gaussian of the distance and, in
turns, by Tukey's biweight of the residual (Beaton and Tukey 1974), so that the bulge itself hardly lifts its own
trend.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import correlate1d, map_coordinates

from ...engine.core.arrays import Float
from ...engine.statistics.robust import nmad

TURNS = 4
MIN_SCALE_M = 0.015
"""Residuals are never weighted as if the ground were smoother than this, m."""


def residual_heights(xyz: Float, along: float, up: float) -> Float:
    """Height of each point (n,) over the robust trend of its surroundings.

    Args:
        xyz: (n, 3) in the slope's flat frame, m. along, up: standard deviations of the Gaussian in x and y, m. Shapes
        wider than about twice these are trend. Where y
            runs up the slope, a long reach in x with a short one in y follows benches, which run along the slope.
    """
    cell = np.array([trend_cell(along), trend_cell(up)])
    low = xyz[:, :2].min(axis=0) - 0.5 * cell
    place = (xyz[:, :2] - low) / cell
    shape = tuple(int(n) + 1 for n in place.max(axis=0))
    level = float(np.median(xyz[:, 2]))
    height = _cell_medians(place, xyz[:, 2] - level, (shape[0], shape[1]))
    trend = robust_trend(height, (along / cell[0], up / cell[1]))
    # Cells hold the trend at their centres.
    values = map_coordinates(trend, (place - 0.5).T, order=1, mode="nearest")
    return np.asarray(xyz[:, 2] - level - values, dtype=np.float64)


def trend_cell(reach: float) -> float:
    """Side (m) of the raster's cells along an axis on which the trend reaches so far."""
    return max(reach / 6.0, 0.2)


def robust_trend(height: Float, sigma: tuple[float, float]) -> Float:
    """Robust local plane at every cell of a raster whose empty cells are NaN; ``sigma`` in cells of either axis.

    Where nothing is within reach, the value is that of the raster's mean.
    """
    known = ~np.isnan(height)
    z = np.where(known, height, 0.0)
    weight = known.astype(np.float64)
    trend = np.zeros_like(z)
    for turn in range(TURNS):
        trend = local_planes(z, weight, sigma)
        if turn == TURNS - 1:
            break
        residual = z - trend
        scale = max(nmad(residual[known], 0.0), MIN_SCALE_M)
        part = np.minimum(np.abs(residual) / (4.685 * scale), 1.0)
        weight = np.where(known, (1.0 - part**2) ** 2 + 1e-3, 0.0)
    return trend


def local_planes(z: Float, weight: Float, sigma: tuple[float, float]) -> Float:
    """Height at each cell of the plane that weighted least squares fit about it."""
    kernels = []
    for deviation in sigma:
        reach = max(1, math.ceil(3 * deviation))
        x = np.arange(-reach, reach + 1) / deviation
        kernels.append([np.exp(-0.5 * x**2) * x**power for power in range(3)])

    def moment(values: Float, i: int, j: int) -> Float:
        first = correlate1d(values, kernels[0][i], axis=0, mode="constant")
        return np.asarray(correlate1d(first, kernels[1][j], axis=1, mode="constant"), dtype=np.float64)

    weighted = weight * z
    m00, m10, m01 = moment(weight, 0, 0), moment(weight, 1, 0), moment(weight, 0, 1)
    m20, m11, m02 = moment(weight, 2, 0), moment(weight, 1, 1), moment(weight, 0, 2)
    b0, b1, b2 = moment(weighted, 0, 0), moment(weighted, 1, 0), moment(weighted, 0, 1)
    # A little stiffness keeps the plane level where the cells known lie on a line.
    stiff = 1e-3 * m00 + 1e-9
    m20, m02 = m20 + stiff, m02 + stiff
    determinant = m00 * (m20 * m02 - m11**2) - m10 * (m10 * m02 - m11 * m01) + m01 * (m10 * m11 - m20 * m01)
    numerator = b0 * (m20 * m02 - m11**2) - m10 * (b1 * m02 - m11 * b2) + m01 * (b1 * m11 - m20 * b2)
    mean = float(weighted.sum() / max(weight.sum(), 1e-12))
    sound = (m00 > 1e-6) & (determinant > 1e-12 * m00**3)
    return np.where(sound, numerator / np.where(sound, determinant, 1.0), mean)


def _cell_medians(place: Float, z: Float, shape: tuple[int, int]) -> Float:
    """Median height in each cell (lower one of an even number), NaN where there is no point."""
    index = place[:, 0].astype(np.int64) * shape[1] + place[:, 1].astype(np.int64)
    order = np.lexsort((z, index))
    count = np.bincount(index, minlength=shape[0] * shape[1])
    middle = np.cumsum(count) - count + (count - 1) // 2
    median = np.full(len(count), np.nan)
    filled = count > 0
    median[filled] = z[order[middle[filled]]]
    return median.reshape(shape)
