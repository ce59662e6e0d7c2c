"""Rasters whose grid is turned, sheared, upside down or not square, on a north-up grid of square cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from affine import Affine
from scipy import ndimage

from ..core.arrays import Float
from ..grid.grid import Grid, snapped_grid

MOST_SIDES_RATIO = 100.0
"""Of a cell's sides to one another, and of the longer one to the width of a sheared cell."""
_SQUARE = 1e-9  # relative difference of the sides of what is a square
_WHOLE = 1.0 - 1e-6  # weight of the known cells around a place where all of them are known
_BLOCK_CELLS = 1_000_000  # that are interpolated at a time


@dataclass(frozen=True)
class Sides:
    """Of a raster's cell: ``width`` and ``height`` along its rows and columns, and ``turned`` degrees of its rows
    counterclockwise from the east; ``sheared`` where rows and columns are not at right angles.
    """

    width: float
    height: float
    turned: float
    sheared: bool


def sides_of(affine: Affine) -> Sides:
    """The sides of the cells of a raster."""
    width, height = math.hypot(affine.a, affine.d), math.hypot(affine.b, affine.e)
    lean = affine.a * affine.b + affine.d * affine.e
    return Sides(
        width, height, math.degrees(math.atan2(affine.d, affine.a)), abs(lean) > _SQUARE * max(width * height, 1e-300)
    )


def has_extent(affine: Affine) -> bool:
    """Whether the cells are areas, whose sides are not of quite different lengths."""
    sides = sides_of(affine)
    longest, area = max(sides.width, sides.height), abs(affine.determinant)
    return area > 0 and longest * longest <= MOST_SIDES_RATIO * area


def laid_straight(heights: Float, affine: Affine) -> tuple[Float, Affine]:
    """Rows and columns exchanged and reversed, so that the first row is the northernmost and the first column the
    westernmost, as far as that is possible without new heights.
    """
    if abs(affine.b) > abs(affine.a) and abs(affine.d) > abs(affine.e):
        heights, affine = heights.T, Affine(affine.b, affine.a, affine.c, affine.e, affine.d, affine.f)
    if affine.e > 0:
        a, b, c, d, e, f = affine[:6]
        rows = heights.shape[0]
        heights, affine = heights[::-1], Affine(a, -b, c + b * rows, d, -e, f + e * rows)
    if affine.a < 0:
        a, b, c, d, e, f = affine[:6]
        columns = heights.shape[1]
        heights, affine = heights[:, ::-1], Affine(-a, b, c + a * columns, -d, e, f + d * columns)
    return np.ascontiguousarray(heights), affine


def plain_grid(affine: Affine, shape: tuple[int, int]) -> Grid | None:
    """The grid of a north-up raster of square cells; None for another."""
    if affine.b or affine.d or affine.a <= 0 or not math.isclose(affine.a, -affine.e, rel_tol=_SQUARE):
        return None
    return Grid(west=affine.c, north=affine.f, cell=affine.a, rows=shape[0], columns=shape[1])


def straight_grid(affine: Affine, shape: tuple[int, int]) -> Grid:
    """North-up cells over all of the raster, as large as the longer side of its own: no detail is invented."""
    sides = sides_of(affine)
    cell = float(f"{max(sides.width, sides.height):.9g}")
    a, b, x, d, e, y = affine[:6]
    corners = np.array([(x + a * c + b * r, y + d * c + e * r) for c in (0, shape[1]) for r in (0, shape[0])])
    (west, south), (east, north) = corners.min(axis=0), corners.max(axis=0)
    return snapped_grid((west, south, east, north), cell)


def resampled(heights: Float, affine: Affine, grid: Grid) -> Float:
    """Mean heights of the cells of ``grid``; NaN where not all of a cell is known.

    The mean is that of evenly spread places in a cell, to each of which the heights of the four nearest cells are
    interpolated (bilinearly). A plane keeps its heights, and what is finer than a cell is smoothed. The mean of a part
    of a cell would lie higher or lower than the cell where the ground is inclined, so that there is none.

    Args:
        heights: (rows, columns) at the middles of the cells of ``affine``, NaN where unknown.
    """
    sides = sides_of(affine)
    number = max(2, math.ceil(grid.cell / min(sides.width, sides.height) - _SQUARE))
    known = np.isfinite(heights)
    about = float(np.median(heights[known])) if known.any() else 0.0  # small numbers keep their digits
    parts = np.where(known, heights - about, 0.0), known.astype(np.float64)
    offsets = (np.arange(number) + 0.5) / number
    result = np.full(grid.shape, np.nan)
    step = max(1, _BLOCK_CELLS // grid.columns)
    for top in range(0, grid.rows, step):
        rows = np.arange(top, min(top + step, grid.rows))
        total = np.zeros((len(rows), grid.columns))
        for down in offsets:
            for across in offsets:
                x = grid.west + (np.arange(grid.columns) + across) * grid.cell
                y = grid.north - (rows + down)[:, None] * grid.cell
                total += _interpolated(parts, ~affine, x, y)
        result[rows] = total / number**2 + about
    return result


def _interpolated(parts: tuple[Float, Float], inverse: Affine, x: Float, y: Float) -> Float:
    """Heights at places (rows, columns), NaN where not known; ``parts`` are heights, and 1 where these are known."""
    column = inverse.a * x + inverse.b * y + inverse.c
    row = inverse.d * x + inverse.e * y + inverse.f
    place = np.stack([row - 0.5, column - 0.5])
    # nothing beyond the outermost middles of cells
    total, weight = (ndimage.map_coordinates(part, place, order=1, mode="constant") for part in parts)
    return np.asarray(np.where(weight >= _WHOLE, total, np.nan))
