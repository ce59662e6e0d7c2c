"""The grid itself: origin, cell and size, and which cell a point falls into."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float


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


def on_grid(cell: NDArray[np.int64], values: NDArray[Any], shape: tuple[int, int], empty: Any = np.nan) -> NDArray[Any]:
    """``values`` (n,) of the cells ``cell`` (n,) on a grid of ``shape``; ``empty`` elsewhere."""
    full = np.full(shape, empty)
    full.ravel()[cell] = values
    return full


def cell_index(xy: Float, grid: Grid) -> NDArray[np.int64]:
    """Flat cell index of each point of ``xy`` (n, 2 or more); -1 outside the grid.

    Cells are half open: a point on a shared edge belongs to the eastern, or northern, cell. Points are given on
    lattices (0.001 m) that share numbers with the cells' edges, hence the tolerance of a millionth of a cell.
    """
    row, column = _row_and_column(xy, grid)
    index = (row * grid.columns + column).astype(np.int64)
    outside = _outside(row, column, grid)
    if outside is not None:
        index[outside] = -1
    return index


def _row_and_column(xy: Float, grid: Grid) -> tuple[Float, Float]:
    """Whole numbers, as floats: they are exact below 2^53."""
    scale = 1.0 / grid.cell
    column = np.floor((xy[:, 0] - grid.west) * scale + 1e-6)
    row = (grid.rows - 1) - np.floor((xy[:, 1] - grid.bounds[1]) * scale + 1e-6)
    return row, column


def _outside(row: Float, column: Float, grid: Grid) -> NDArray[np.bool_] | None:
    """Points outside the grid; None: none is."""
    if not row.size or (min(row.min(), column.min()) >= 0 and row.max() < grid.rows and column.max() < grid.columns):
        return None
    outside: NDArray[np.bool_] = (column < 0) | (column >= grid.columns) | (row < 0) | (row >= grid.rows)
    return outside
