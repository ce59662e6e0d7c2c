"""Inclination of the surface at each cell of a grid, from the cells around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .window_sums import RunningSums, Whole, Windows, fixed_point, windows_around

if TYPE_CHECKING:
    from .gridding import Grid

Float = NDArray[np.float64]
Chosen = NDArray[np.bool_]
Cells = NDArray[np.intp]

_REACH = 0.5  # metres from a cell within which its neighbours tell its slope
_LEAST_CELLS = 2  # ... and cells, where these are large
_WIDER = (2.0, 4.0)  # times the reach where too few cells are within it
_BAND = 60_000  # cells whose running sums are held at a time: what a processor's cache holds
_FEW = 0.3  # cells to look at, in shares of the grid's, up to which looking is faster than running sums


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
    row, column = np.indices(grid.shape).reshape(2, -1) if where is None else np.nonzero(where)
    for radius in radii:
        planes = _planes_of_few if row.size * (2 * radius + 1) ** 2 < _FEW * east.size else _planes_in_bands
        found = planes(heights, row, column, radius)
        east[row, column], north[row, column] = found[0] / grid.cell, found[1] / grid.cell
        unknown = np.isnan(found[0])
        row, column = row[unknown], column[unknown]
        if not row.size:
            break
    return east, north


@dataclass(frozen=True)
class _Products:
    """Number of known cells in each window, and sums of products about their means (x east, y north, in cells)."""

    n: Float
    xx: Float
    yy: Float
    xy: Float
    xz: Float
    yz: Float


def _planes_of_few(heights: Sequence[Float], row: Cells, column: Cells, radius: int) -> tuple[Float, Float]:
    """As ``_planes_in_bands``, looking at every cell of every window."""
    step = np.arange(-radius, radius + 1)
    i, j = row[:, None, None] + step[:, None], column[:, None, None] + step
    rows, columns = heights[0].shape
    inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
    i, j = np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1)
    parts = []
    for height in heights:
        z = height[i, j]
        known = inside & np.isfinite(z)
        n = known.sum(axis=(1, 2))
        # about the means: coordinates that are zero where nothing is known
        x, y, z = (
            np.where(known, a - _mean(a, known, n), 0.0)
            for a in np.broadcast_arrays(step.astype(np.float64), -step[:, None].astype(np.float64), z)
        )
        parts.append(
            _Products(
                n.astype(np.float64), *((a * b).sum(axis=(1, 2)) for a, b in ((x, x), (y, y), (x, y), (x, z), (y, z)))
            )
        )
    return _solved(parts)


def _mean(values: Float, known: Chosen, n: Cells) -> Float:
    total = np.where(known, values, 0.0).sum(axis=(1, 2))
    return (total / np.maximum(n, 1))[:, None, None]


def _planes_in_bands(heights: Sequence[Float], row: Cells, column: Cells, radius: int) -> tuple[Float, Float]:
    """Gradient east and north, metres a cell, of the plane through the ``radius`` around each cell; NaN: none is fixed.

    ``row`` must ascend.
    """
    rows, columns = heights[0].shape
    lines = max(_BAND // columns, 4 * radius)
    east, north = np.full((2, row.size), np.nan)
    for top in range(0, rows, lines):
        here = slice(*np.searchsorted(row, (top, top + lines)))
        band = slice(max(top - radius, 0), top + lines + radius)
        known = [h[band] for h in heights if np.isfinite(h[band]).any()]
        if here.start == here.stop or not known:
            continue
        i, j = row[here] - band.start, column[here]
        windows = windows_around(i, j, radius, known[0].shape)
        east[here], north[here] = _solved([_products(h, i, j, windows, radius) for h in known])
    return east, north


def _products(height: Float, row: Whole, column: Whole, windows: Windows, radius: int) -> _Products:
    known = np.isfinite(height)
    low, high = np.fmin.reduce(height, axis=None), np.fmax.reduce(height, axis=None)
    level, largest = (low + high) / 2, (2 * radius + 1) ** 2 * radius  # sum of |i| over a window, at most
    z, unit = fixed_point(np.where(known, height - level, 0.0), largest * max(high - level, 1e-3))
    i: Whole = np.arange(height.shape[0])[:, None]
    j: Whole = np.arange(height.shape[1])
    sum_z, zi, zj = RunningSums([z, z * i, z * j]).totals(windows)
    xz, yz = zj - column * sum_z, row * sum_z - zi
    narrow = np.int32 if largest * radius < 2**31 else np.int64
    one, i, j, row, column = (a.astype(narrow) for a in (known, i, j, row, column))
    in_row, in_column = one * i, one * j
    n, ni, nj, nii, njj, nij = RunningSums([one, in_row, in_column, in_row * i, in_column * j, in_row * j]).totals(
        windows
    )
    # from the cell at the middle: small whole numbers, exact
    x, y = nj - column * n, row * n - ni
    xx, yy, xy = njj - column * (nj + x), nii - row * (ni - y), row * x - nij + column * ni
    mean = 1.0 / np.maximum(n, 1)
    mean_x, mean_y = x * mean, y * mean
    return _Products(
        n=n.astype(np.float64),
        xx=xx - x * mean_x,
        yy=yy - y * mean_y,
        xy=xy - x * mean_y,
        xz=(xz - sum_z * mean_x) * unit,
        yz=(yz - sum_z * mean_y) * unit,
    )


def _solved(parts: Sequence[_Products]) -> tuple[Float, Float]:
    """The gradient that the surfaces of all ``parts`` share."""
    cells, xx, yy, xy, xz, yz = (sum(getattr(p, f.name) for p in parts) for f in fields(_Products))
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
