"""Inclination of the surface at each cell of a grid, from the cells around it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .window_sums import RunningSums, Whole, fixed_point

if TYPE_CHECKING:
    from .gridding import Grid

Float = NDArray[np.float64]
Chosen = NDArray[np.bool_]

_REACH = 0.5  # metres from a cell within which its neighbours tell its slope
_LEAST_CELLS = 2  # ... and cells, where these are large
_WIDER = (2.0, 4.0)  # times the reach where too few cells are within it
_BAND = 500_000  # cells whose running sums are held at a time


def slope_gradient(
    heights: Sequence[Float], grid: Grid, *, reach: float = _REACH, where: Chosen | None = None
) -> tuple[Float, Float]:
    """Eastward and northward rise of the surface at each cell (rows, columns), metres a metre.

    The least-squares plane through the cells within ``reach`` metres (at least two cells) east, west, north and south.
    All of ``heights`` (each (rows, columns), NaN where unknown) share one slope but not one height, so that what has
    been raised or lowered as a whole between two epochs does not tilt it. NaN where the cells around fix no plane.

    Args:
        where: cells whose slope is wanted, all without; NaN in the others.
    """
    return _gradient(heights, grid, (_radius(reach, grid),), where)


def widened_gradient(
    heights: Sequence[Float], grid: Grid, *, reach: float = _REACH, where: Chosen | None = None
) -> tuple[Float, Float]:
    """As ``slope_gradient``, with twice and four times the reach where fewer cells than it takes are near."""
    return _gradient(heights, grid, tuple(_radius(times * reach, grid) for times in (1.0, *_WIDER)), where)


def _radius(reach: float, grid: Grid) -> int:
    return max(_LEAST_CELLS, round(reach / grid.cell))


def _gradient(
    heights: Sequence[Float], grid: Grid, radii: tuple[int, ...], where: Chosen | None
) -> tuple[Float, Float]:
    """With the first of the ``radii`` (cells, ascending) that fixes a plane, cell by cell."""
    east, north = np.full((2, *grid.shape), np.nan)
    halo = max(radii)
    lines = max(4 * halo, _BAND // grid.columns, 1)
    for top in range(0, grid.rows, lines):
        bottom = min(top + lines, grid.rows)
        row, column = np.nonzero(np.ones((bottom - top, grid.columns)) if where is None else where[top:bottom])
        above = max(top - halo, 0)
        band = slice(above, bottom + halo)
        sums = [_Sums(h[band], halo) for h in heights if np.isfinite(h[band]).any()]
        for radius in radii if sums else ():
            found = _planes(sums, row + (top - above), column, radius)
            east[row + top, column], north[row + top, column] = found[0] / grid.cell, found[1] / grid.cell
            unknown = np.isnan(found[0])
            row, column = row[unknown], column[unknown]
            if not row.size:
                break
    return east, north


class _Sums:
    """Sums over windows of one epoch's cells and heights: of 1, i, j, ii, jj, ij, z, iz, jz (i row, j column)."""

    def __init__(self, height: Float, radius: int) -> None:
        known = np.isfinite(height)
        low, high = np.min(height, where=known, initial=np.inf), np.max(height, where=known, initial=-np.inf)
        level = (low + high) / 2
        # the largest sum over a window is that of iz
        largest = max(high - level, 1e-3) * max(radius, 1) * (2 * radius + 1) ** 2
        z, self._unit = fixed_point(np.where(known, height - level, 0.0), largest)
        n = known.astype(np.int64)
        i, j = np.arange(n.shape[0])[:, None], np.arange(n.shape[1])
        ni, nj = n * i, n * j
        self._sums = RunningSums([n, ni, nj, ni * i, nj * j, ni * j, z, z * i, z * j])

    def about(self, row: Whole, column: Whole, radius: int) -> tuple[Float, ...]:
        """n, and the sums of squares and products about the means: xx, yy, xy, xz, yz (x east, y north; cells)."""
        windows = self._sums.windows(row, column, radius)
        n, ni, nj, nii, njj, nij, z, zi, zj = (self._sums.total(number, windows) for number in range(9))
        # from the cell at the middle: small whole numbers, exact
        y, x = row * n - ni, nj - column * n
        yy = nii - row * (ni - y)
        xx = njj - column * (nj + x)
        xy = row * x - (nij - column * ni)
        yz, xz = row * z - zi, zj - column * z
        mean = 1.0 / np.maximum(n, 1)
        mean_x, mean_y = x * mean, y * mean
        return (
            n.astype(np.float64),
            xx - x * mean_x,
            yy - y * mean_y,
            xy - x * mean_y,
            (xz - z * mean_x) * self._unit,
            (yz - z * mean_y) * self._unit,
        )


def _planes(sums: Sequence[_Sums], row: Whole, column: Whole, radius: int) -> tuple[Float, Float]:
    """Gradient east and north, metres a cell, of the planes around the cells ``row``, ``column``; NaN: none fixed."""
    cells, xx, yy, xy, xz, yz = (
        sum(parts) for parts in zip(*(s.about(row, column, radius) for s in sums), strict=True)
    )
    determinant = xx * yy - xy * xy
    # three cells in a row leave the plane free to turn about them
    fixed = (cells > 2.5) & (determinant > 1e-3 * (xx + yy) ** 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(fixed, 1.0 / determinant, np.nan)
        return (xz * yy - yz * xy) * factor, (yz * xx - xz * xy) * factor


def slope_degrees(gradient: tuple[Float, Float]) -> Float:
    """Degrees to the horizontal; NaN where the gradient is unknown."""
    degrees: Float = np.degrees(np.arctan(np.hypot(*gradient)))
    return degrees
