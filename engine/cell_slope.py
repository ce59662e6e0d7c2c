"""Inclination of the surface at each cell of a grid, from the cells around it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

if TYPE_CHECKING:
    from .gridding import Grid

Float = NDArray[np.float64]

_REACH = 0.5  # metres from a cell within which its neighbours tell its slope
_LEAST_CELLS = 2  # ... and cells, where these are large


def slope_gradient(heights: Sequence[Float], grid: Grid, *, reach: float = _REACH) -> tuple[Float, Float]:
    """Eastward and northward rise of the surface at each cell (rows, columns), metres a metre.

    The least-squares plane through the cells within ``reach`` metres (at least two cells) east, west, north and south.
    All of ``heights`` (each (rows, columns), NaN where unknown) share one slope but not one height, so that what has
    been raised or lowered as a whole between two epochs does not tilt it. NaN where the cells around fix no plane.
    """
    radius = max(_LEAST_CELLS, round(reach / grid.cell))
    step: Float = np.arange(-radius, radius + 1, dtype=np.float64) * grid.cell
    one, square = np.ones_like(step), step * step
    xx, yy, xy, xz, yz = np.zeros((5, *grid.shape))
    cells = np.zeros(grid.shape)

    def around(values: Float, east: Float, south: Float) -> Float:
        # one axis after the other; nothing lies beyond the edge
        rows = ndimage.correlate1d(values, south, axis=0, mode="constant")
        found: Float = ndimage.correlate1d(rows, east, axis=1, mode="constant")
        return found

    for height in heights:
        known = np.isfinite(height)
        if not known.any():
            continue
        here = known.astype(np.float64)
        z = np.where(known, height - np.median(height[known]), 0.0)
        n = around(here, one, one)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(n > 0.5, 1.0 / n, 0.0)
        x, y, sum_z = around(here, step, one), around(here, one, -step), around(z, one, one)
        xx += around(here, square, one) - x * x * share
        yy += around(here, one, square) - y * y * share
        xy += around(here, step, -step) - x * y * share
        xz += around(z, step, one) - x * sum_z * share
        yz += around(z, one, -step) - y * sum_z * share
        cells += n
    determinant = xx * yy - xy * xy
    with np.errstate(invalid="ignore", divide="ignore"):
        # three cells in a row leave the plane free to turn about them
        fixed = (cells > 2.5) & (determinant > 1e-3 * (xx + yy) ** 2)
        east = np.where(fixed, (xz * yy - yz * xy) / determinant, np.nan)
        north = np.where(fixed, (yz * xx - xz * xy) / determinant, np.nan)
    return east, north


def widened_gradient(heights: Sequence[Float], grid: Grid, *, reach: float = _REACH) -> tuple[Float, Float]:
    """As ``slope_gradient``, with twice and four times the reach where fewer cells than it takes are near."""
    east, north = slope_gradient(heights, grid, reach=reach)
    for wider in (2.0, 4.0):
        unknown = np.isnan(east)
        if not unknown.any():
            break
        more = slope_gradient(heights, grid, reach=wider * reach)
        east[unknown], north[unknown] = more[0][unknown], more[1][unknown]
    return east, north


def slope_degrees(gradient: tuple[Float, Float]) -> Float:
    """Degrees to the horizontal; NaN where the gradient is unknown."""
    degrees: Float = np.degrees(np.arctan(np.hypot(*gradient)))
    return degrees
