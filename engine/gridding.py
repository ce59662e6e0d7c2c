"""Common grid of two epochs and the statistics of the points in its cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .cell_slope import widened_gradient

Float = NDArray[np.float64]

_NEIGHBOURHOOD = 0.3  # metres around a cell whose cells tell its slope
_POINTS_FOR_A_PLANE = 12  # measured on simulated faces of 30 to 60 degrees, cells of 0.1 to 1 m


@dataclass(frozen=True)
class Grid:
    """North-up grid. Row 0 is the northernmost; ``west`` and ``north`` are multiples of ``cell``.

    ``bounds`` and coordinates are in metres of the working reference system.
    """

    west: float
    north: float
    cell: float
    rows: int
    columns: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows, self.columns

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        return self.west, self.north - self.rows * self.cell, self.west + self.columns * self.cell, self.north

    @property
    def affine(self) -> tuple[float, float, float, float, float, float]:
        """The six numbers of ``affine.Affine``: x of column, y of row at a pixel's upper left corner."""
        return self.cell, 0.0, self.west, 0.0, -self.cell, self.north


def snapped_grid(bounds: tuple[float, float, float, float], cell: float) -> Grid:
    """The smallest grid that covers ``bounds`` (west, south, east, north), edges snapped to multiples of ``cell``.

    A point on the east or south edge gets a cell of its own rather than falling outside (see ``cell_index``).
    """
    first_column = math.floor(bounds[0] / cell + 1e-9)
    last_column = math.floor(bounds[2] / cell + 1e-9)
    first_row = math.floor(bounds[1] / cell + 1e-9)
    last_row = math.floor(bounds[3] / cell + 1e-9)
    return Grid(
        west=first_column * cell,
        north=(last_row + 1) * cell,
        cell=cell,
        rows=last_row - first_row + 1,
        columns=last_column - first_column + 1,
    )


@dataclass(frozen=True)
class CellStatistics:
    """Statistics of the points in each cell; arrays of shape (rows, columns).

    ``height`` is NaN in cells without points. ``variance`` is that of the points about the cell's height model (their
    mean, or the plane), with ``degrees`` of freedom left; NaN where none is left. ``leverage`` times the variance
    of a point is the variance of ``height``: 1/n for a mean, ((X'X)^-1)_00 for a plane. ``tilted`` marks the cells
    whose height is that of a plane; ``scatter`` is the variance about the mean in every cell, with count - 1 degrees.
    """

    count: NDArray[np.int64]
    height: Float
    variance: Float
    degrees: Float
    leverage: Float
    tilted: NDArray[np.bool_]
    scatter: Float


def cell_index(xy: Float, grid: Grid) -> NDArray[np.int64]:
    """Flat cell index of each point of ``xy`` (n, 2 or more); -1 outside the grid.

    Cells are half open: a point on a shared edge belongs to the eastern, or northern, cell. Points are given on
    lattices (0.001 m) that share numbers with the cells' edges, hence the tolerance of a millionth of a cell.
    """
    scale = 1.0 / grid.cell
    south = grid.bounds[1]
    column = np.floor((xy[:, 0] - grid.west) * scale + 1e-6).astype(np.int64)
    row = grid.rows - 1 - np.floor((xy[:, 1] - south) * scale + 1e-6).astype(np.int64)
    index = row * grid.columns + column
    outside = (column < 0) | (column >= grid.columns) | (row < 0) | (row >= grid.rows)
    if outside.any():
        index[outside] = -1
    return index


def sloping_statistics(xyz: Float, grid: Grid) -> CellStatistics:
    """As ``cell_statistics``, of points (n, 3) from which the slope of the ground around each cell has been removed.

    On a slope the mean height of a cell depends on where in the cell its few points happen to lie, and their variance
    is mostly the slope's own rise. The slope that the cells around tell (``cell_slope``) is taken from each point
    before the mean, so that even a single point gives the height at the cell's centre. Cells with
    ``_POINTS_FOR_A_PLANE`` points follow their own surface by a plane of their own; with fewer, its scatter costs more
    than it gains.
    """
    east, north = widened_gradient([cell_statistics(xyz, grid).height], grid, reach=_NEIGHBOURHOOD)
    index = cell_index(xyz, grid)
    inside = index >= 0
    index, xyz = index[inside], xyz[inside]
    u, v = _from_centre(xyz, index, grid)
    rise = np.nan_to_num(east.ravel()[index]) * u + np.nan_to_num(north.ravel()[index]) * v
    del east, north
    level = np.column_stack([xyz[:, :2], xyz[:, 2] - rise])
    return cell_statistics(level, grid, plane=True, least=_POINTS_FOR_A_PLANE)


def _from_centre(xyz: Float, index: NDArray[np.int64], grid: Grid) -> tuple[Float, Float]:
    """Metres east and north of the centre of the cell ``index`` that each point lies in."""
    row, column = np.divmod(index, grid.columns)
    u = xyz[:, 0] - (grid.west + (column + 0.5) * grid.cell)
    v = xyz[:, 1] - (grid.north - (row + 0.5) * grid.cell)
    return u, v


def cell_statistics(xyz: Float, grid: Grid, *, plane: bool = False, least: int = 4) -> CellStatistics:
    """Count, height and variance of the points (n, 3) of each cell.

    Args:
        plane: fit z = a + b x + c y in each cell and take its value at the cell's centre, rather than the mean. It
            removes the error that uneven sampling of a sloping cell brings. Cells with fewer than ``least``
            points, or whose points lie nearly on a line, keep the mean.
        least: at least four.
    """
    index = cell_index(xyz, grid)
    if index.size and index.min() < 0:
        inside = index >= 0
        index, xyz = index[inside], xyz[inside]
    cells = grid.rows * grid.columns
    count = np.bincount(index, minlength=cells)
    # heights about a common level: squares of small numbers keep their digits
    level = float(np.median(xyz[:: max(1, len(xyz) // 10_000), 2])) if len(xyz) else 0.0
    z = xyz[:, 2] - level
    with np.errstate(invalid="ignore", divide="ignore"):
        sum_z = np.bincount(index, weights=z, minlength=cells)
        sum_zz = np.bincount(index, weights=z * z, minlength=cells)
        height = sum_z / count
        degrees = np.maximum(count - 1.0, 0.0)
        squares = np.maximum(sum_zz - sum_z * height, 0.0)
        leverage = 1.0 / count
        tilted = np.zeros(cells, dtype=bool)
        scatter = np.where(degrees > 0, squares / degrees, np.nan)
        if plane:
            height, squares, degrees, leverage, tilted = _plane_in_cell(
                xyz, z, index, grid, count, height, squares, degrees, leverage, least
            )
        variance = np.where(degrees > 0, squares / degrees, np.nan)
    leverage[count == 0] = np.nan
    shape = grid.shape
    return CellStatistics(
        count=count.reshape(shape),
        height=(height + level).reshape(shape),
        variance=variance.reshape(shape),
        degrees=degrees.reshape(shape),
        leverage=leverage.reshape(shape),
        tilted=tilted.reshape(shape),
        scatter=scatter.reshape(shape),
    )


def _plane_in_cell(
    xyz: Float,
    z: Float,
    index: NDArray[np.int64],
    grid: Grid,
    count: NDArray[np.int64],
    mean: Float,
    squares: Float,
    degrees: Float,
    leverage: Float,
    least: int,
) -> tuple[Float, Float, Float, Float, NDArray[np.bool_]]:
    """Least squares in centred moments: height at the cell's centre, residual squares, degrees, leverage, where."""
    cells = grid.rows * grid.columns
    u, v = _from_centre(xyz, index, grid)

    def total(values: Float) -> Float:
        return np.bincount(index, weights=values, minlength=cells).astype(np.float64, copy=False)

    mean_u, mean_v = total(u) / count, total(v) / count
    du, dv, dz = u - mean_u[index], v - mean_v[index], z - mean[index]
    suu, svv, suv = total(du * du), total(dv * dv), total(du * dv)
    suz, svz = total(du * dz), total(dv * dz)
    determinant = suu * svv - suv * suv
    slope_u = (suz * svv - svz * suv) / determinant
    slope_v = (svz * suu - suz * suv) / determinant
    at_centre = mean - slope_u * mean_u - slope_v * mean_v
    extrapolation = (mean_u**2 * svv - 2 * mean_u * mean_v * suv + mean_v**2 * suu) / determinant
    # a spread of at least a tenth of the cell in every direction; else the plane tilts freely
    enough = (
        (count >= max(least, 4)) & (determinant > 1e-4 * (count * grid.cell**2 / 12.0) ** 2) & (extrapolation < 1.0)
    )
    rest = np.maximum(squares - slope_u * suz - slope_v * svz, 0.0)
    return (
        np.where(enough, at_centre, mean),
        np.where(enough, rest, squares),
        np.where(enough, count - 3.0, degrees),
        np.where(enough, 1.0 / count + extrapolation, leverage),
        enough,
    )
