"""Inclination of the surface at each cell of a grid, from the cells around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..core.compiled import compiled
from ..geometry.plane_gradient import gradient_parts
from ..statistics import window_kernels
from ..statistics.window_sums import Cells, Windows, slide
from .grid import Grid

Counts = NDArray[np.signedinteger[Any]]
Numbers = NDArray[Any]

_REACH_M = 0.5  # metres from a cell: its neighbours within give its slope
_MIN_REACH_CELLS = 2  # ... and cells, where these are large
_WIDER_REACHES = (2.0, 4.0)  # times the reach where too few cells are within it
_MAX_NARROW_RADIUS_CELLS = 12  # cells of radius within which all sums of squares of places are below 2^15
_MAX_FEW_SHARE = 0.3  # cells to look at, in shares of the grid's, up to which looking is faster than running sums


Surface = tuple[Cells, Float]
"""The cells of which a height is known (k,), and the heights, metres."""


def gradient_at(
    cell: Cells,
    surfaces: Sequence[Surface],
    grid: Grid,
    *,
    reach: float = _REACH_M,
    wider: Sequence[float] = _WIDER_REACHES,
) -> tuple[Float, Float]:
    """Eastward and northward rise of the surface at each of the cells ``cell``, (n,), metres a metre.

    The least-squares plane through the cells within ``reach`` metres (at least two cells) east, west, north and south.
    All ``surfaces`` share one slope but not one height, so that what has been raised or lowered as a whole between two
    epochs does not tilt it. NaN where the cells around fix no plane, nor those within ``wider`` times the reach.
    """
    east, north = _planes(cell, surfaces, grid, reach)
    for times in wider:
        unknown = np.flatnonzero(np.isnan(east))
        if unknown.size:
            east[unknown], north[unknown] = _planes(cell[unknown], surfaces, grid, times * reach)
    return east, north


def _planes(cell: Cells, surfaces: Sequence[Surface], grid: Grid, reach: float) -> tuple[Float, Float]:
    windows = Windows(cell, grid.shape, max(_MIN_REACH_CELLS, round(reach / grid.cell)))
    few = cell.size * windows.size**2 < _MAX_FEW_SHARE * grid.rows * grid.columns
    # about their mean: small numbers keep their digits
    surfaces = [(known, height - height.mean() if height.size else height) for known, height in surfaces]
    if few:
        east, north = _planes_of_few([_padded(*s, windows) for s in surfaces], windows)
    elif windows.compiled_pays(sum(known.size for known, _ in surfaces)):
        joined = np.concatenate([known for known, _ in surfaces]), np.concatenate([height for _, height in surfaces])
        starts = np.cumsum([0, *(known.size for known, _ in surfaces)])
        east, north = _window_planes(cell, (*joined, starts), windows.shape, windows.radius, windows.lines)
    else:
        east, north = _planes_in_parts([_padded(*s, windows) for s in surfaces], windows)
    return east / grid.cell, north / grid.cell


def _padded(cell: Cells, about: Float, windows: Windows) -> tuple[Float, Counts]:
    """Heights on the padded grid, 0 where none is known, and where one is: 1, or 0, as narrow as sums of products of
    places in a window allow.
    """
    known = np.ones(about.size, dtype=np.int16 if windows.radius <= _MAX_NARROW_RADIUS_CELLS else np.int32)
    padded = windows.padded(cell, about, known)
    return padded[0], padded[1]


@dataclass(frozen=True)
class _Products:
    """Number of known cells in each window, and sums of products about their means (x east, y north, in cells)."""

    n: Float
    xx: Float
    yy: Float
    xy: Float
    xz: Float
    yz: Float


def _planes_of_few(surfaces: Sequence[tuple[Float, Counts]], windows: Windows) -> tuple[Float, Float]:
    """As ``_planes_in_parts``, looking at every cell of every window."""
    row, column = np.divmod(windows.cell, windows.shape[1])
    step = np.arange(windows.size)
    i, j = row[:, None, None] + step[:, None], column[:, None, None] + step
    parts = []
    for z, known in surfaces:
        one = known[i, j].astype(np.float64)
        n = one.sum(axis=(1, 2))
        # about the means: coordinates that are zero where nothing is known
        x, y, about = (
            (a - ((a * one).sum(axis=(1, 2)) / np.maximum(n, 1.0))[:, None, None]) * one
            for a in (step.astype(np.float64), -step[:, None].astype(np.float64), z[i, j])
        )
        products = ((a * b).sum(axis=(1, 2)) for a, b in ((x, x), (y, y), (x, y), (x, about), (y, about)))
        parts.append(_Products(n, *products))
    return _solved(parts)


def _planes_in_parts(surfaces: Sequence[tuple[Float, Counts]], windows: Windows) -> tuple[Float, Float]:
    """Gradient east and north, metres a cell, of the plane through each window's cells; NaN: none is fixed."""
    east, north = np.empty((2, windows.cell.size))
    for here, part, row, column in windows.parts():
        parts = [_products(z[part], known[part], row, column, windows.radius) for z, known in surfaces]
        east[here], north[here] = _solved(parts)
    return east, north


def _products(z: Float, known: Counts, row: Cells, column: Cells, radius: int) -> _Products:
    """Of the windows that begin at ``row``, ``column`` of a part of the padded grid."""
    line, size, narrow = z.shape[1], 2 * radius + 1, known.dtype
    corner = row * line + column

    def along(cells: Numbers) -> Numbers:
        return slide(cells.ravel(), size)

    def total(cells: Numbers) -> Numbers:
        return slide(cells, size, line).take(corner)

    j = np.arange(line)
    known_j = known * j.astype(narrow)
    one, one_j, one_jj = along(known), along(known_j), along(known_j * j.astype(narrow))
    z, zj = along(z), along(z * j.astype(np.float64))
    i = np.repeat(np.arange(known.shape[0]), line)[: one.size]
    sum_z, zi, zj = total(z), total(z * i.astype(np.float64)), total(zj)
    i = i.astype(narrow)
    one_i = one * i
    n, ni, nj = total(one), total(one_i), total(one_j)
    nii, njj, nij = total(one_i * i), total(one_jj), total(one_j * i)
    # from the cell at the middle: small whole numbers, exact
    row, column = ((a + radius).astype(narrow) for a in (row, column))
    x, y = nj - column * n, row * n - ni
    xx, yy, xy = njj - column * (nj + x), nii - row * (ni - y), row * x - nij + column * ni
    xz, yz = zj - column.astype(np.float64) * sum_z, row.astype(np.float64) * sum_z - zi
    cells: Float = n.astype(np.float64)
    x, y = x.astype(np.float64), y.astype(np.float64)
    mean = 1.0 / np.maximum(cells, 1.0)
    mean_x, mean_y = x * mean, y * mean
    return _Products(
        n=cells,
        xx=xx - x * mean_x,
        yy=yy - y * mean_y,
        xy=xy - x * mean_y,
        xz=xz - sum_z * mean_x,
        yz=yz - sum_z * mean_y,
    )


def _solved(parts: Sequence[_Products]) -> tuple[Float, Float]:
    """The gradient that the surfaces of all ``parts`` share."""
    cells, xx, yy, xy, xz, yz = (reduce(np.add, (getattr(p, f.name) for p in parts)) for f in fields(_Products))
    east, north, determinant = gradient_parts(xx, yy, xy, xz, yz)
    # three cells in a row leave the plane free to turn about them
    fixed = (cells > 2.5) & (determinant > 1e-3 * (xx + yy) ** 2)
    factor = 1.0 / np.where(fixed, determinant, np.nan)
    return east * factor, north * factor


def _planes_by_numpy(
    wanted: Cells, surfaces: tuple[Cells, Float, Index], grid_shape: tuple[int, int], radius: int, lines: int
) -> Float:
    del lines  # of a strip: the loop's alone
    windows, (cell, height, starts) = Windows(wanted, grid_shape, radius), surfaces
    parts = [slice(*ends) for ends in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)]
    return np.array(_planes_in_parts([_padded(cell[part], height[part], windows) for part in parts], windows))


_window_planes = compiled(_planes_by_numpy, *window_kernels.HELPERS)(window_kernels.window_planes)


def slope_degrees(gradient: tuple[Float, Float]) -> Float:
    """Degrees to the horizontal; NaN where the gradient is unknown."""
    degrees: Float = np.degrees(np.arctan(np.hypot(*gradient)))
    return degrees


def class_of_slope(slope: Float, width: float) -> NDArray[np.int8]:
    """Number of the class, ``width`` degrees wide, that each slope (n,) of 0 to 90 degrees is in; -1 where unknown."""
    return np.where(np.isnan(slope), -1.0, slope / width).astype(np.int8)
