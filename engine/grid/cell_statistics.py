"""Common grid of two epochs and the statistics of the points in its cells."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..core.compiled import compiled, pays
from ..geometry.plane_gradient import gradient_parts
from . import cell_kernels
from .cell_slope import gradient_at
from .grid import Grid, _outside, _row_and_column, cell_index, on_grid

_NEIGHBOURHOOD_M = 0.3  # metres around a cell: the cells within give its slope
_LEVEL_POINTS = 10_000
_MIN_COMPILED_POINTS = 1_000_000  # of a survey, from which on loading the compiled loops pays for itself
_MIN_PLANE_POINTS = 12  # measured on simulated faces of 30 to 60 degrees, cells of 0.1 to 1 m


@dataclass(frozen=True)
class CellStatistics:
    """Statistics of the points in each cell that has any: arrays (cells,), of ``cell``, ascending flat indices.

    ``count`` is that of the points of every cell, (rows, columns). ``variance`` is that of the points about the cell's
    height model (their mean, or the plane), with ``degrees`` of freedom left; NaN where none is left. ``leverage``
    times the variance of a point is the variance of ``height``: 1/n for a mean, ((X'X)^-1)_00 for a plane. ``tilted``
    marks the cells whose height is that of a plane; ``scatter`` is the variance about the mean in every cell, with one
    degree less than points. ``plant_error`` and ``plant_height`` are the means of the points' (``plant_cover``),
    metres; None where they are not known.
    """

    count: NDArray[np.int64]
    cell: NDArray[np.int64]
    height: Float
    variance: Float
    degrees: Float
    leverage: Float
    tilted: NDArray[np.bool_]
    scatter: Float
    plant_error: Float | None = None
    plant_height: Float | None = None

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = self.count.shape
        return rows, columns

    @property
    def points(self) -> NDArray[np.int64]:
        """How many each cell has, (cells,)."""
        return self.count.ravel().take(self.cell)

    @property
    def plants(self) -> tuple[Float | None, Float | None]:
        """Error by plants and their height on the grid (rows, columns), metres; None for what is not known."""
        error, height = self.plant_error, self.plant_height
        return None if error is None else self.on_grid(error), None if height is None else self.on_grid(height)

    def on_grid(self, values: NDArray[Any], empty: Any = np.nan) -> NDArray[Any]:
        """``values`` (cells,) on the grid (rows, columns); ``empty`` where no points are."""
        return on_grid(self.cell, values, self.shape, empty)


def sloping_statistics(xyz: Float, grid: Grid) -> CellStatistics:
    """As ``cell_statistics``, of points (n, 3) from which the slope of the ground around each cell has been removed.

    On a slope the mean height of a cell depends on where in the cell its few points happen to lie, and their variance
    is mostly the slope's own rise. The slope of the cells around (``cell_slope``) is taken off each point
    before the mean, so that even a single point gives the height at the cell's centre. Cells with
    ``_MIN_PLANE_POINTS`` points follow their own surface by a plane of their own; with fewer, its scatter costs more
    than it gains.
    """
    if compiled_pays(len(xyz), grid):
        return _compiled_statistics(np.require(xyz, np.float64, ["C", "W"]), grid)
    return _of_sums(_sums(_points_in_cells(xyz, grid, _level(xyz, grid)), spread=True), grid, sloping=True)


def compiled_pays(points: int, grid: Grid) -> bool:
    """Whether ``sloping_statistics`` of so many points takes compiled loops, which do not hold Python's lock."""
    return pays(points, _MIN_COMPILED_POINTS) and max(points, grid.rows * grid.columns) < 2**31


def _compiled_statistics(xyz: Float, grid: Grid) -> CellStatistics:
    frame = grid.west, grid.bounds[1], grid.north, grid.cell, 1.0 / grid.cell
    level = float(np.median(xyz[:: max(1, len(xyz) // _LEVEL_POINTS), 2])) if len(xyz) else 0.0
    count, sums = _cell_sums(xyz, frame, grid.shape, level)
    if count.sum() < len(xyz):  # some lie outside, but the level was theirs, too
        return _compiled_statistics(xyz[cell_index(xyz, grid) >= 0], grid)
    cell = np.flatnonzero(count > 0)
    n, around = count[cell], np.array(_slope_around(cell, sums[0], grid))
    values = _cell_values(sums, n, around, (level, grid.cell**2, _MIN_PLANE_POINTS))
    height, variance, degrees, leverage, tilted, scatter = values
    return CellStatistics(count.reshape(grid.shape), cell, height, variance, degrees, leverage, tilted > 0, scatter)


def statistics_of_parts(
    parts: Iterable[tuple[Float, list[NDArray[np.floating]]]], level: float, grid: Grid, *, sloping: bool
) -> CellStatistics:
    """As ``sloping_statistics``, or ``cell_statistics`` of means, from parts that hold all points of their cells.

    Args:
        parts: points (n, 3) within the grid, and what is known of the plants over them: no, one or two arrays (n,).
        level: ``median_level`` of all.
    """
    found, plants = [], []
    for xyz, values in parts:
        points = _points_in_cells(xyz, grid, level)
        found.append(_sums(points, spread=sloping))
        n = found[-1].n
        plants.append([np.bincount(points.number, weights=v, minlength=n.size) / n for v in values])
    order = np.argsort(np.concatenate([sums.cell for sums in found]), kind="stable")
    arrays = {
        f.name: np.concatenate([getattr(sums, f.name) for sums in found])[order]
        for f in fields(_Sums)
        if f.name != "level"
    }
    cells = _of_sums(_Sums(level=level, **arrays), grid, sloping=sloping)
    known = [np.concatenate(values)[order] for values in zip(*plants, strict=True)]
    return replace(cells, plant_error=known[0] if known else None, plant_height=known[1] if len(known) > 1 else None)


def _of_sums(cells: _Sums, grid: Grid, *, sloping: bool) -> CellStatistics:
    if not sloping:
        return _statistics(cells, grid, least=None)
    east, north = (np.nan_to_num(component) for component in _slope_around(cells.cell, cells.height, grid))
    return _statistics(_without_slope(cells, east, north), grid, least=_MIN_PLANE_POINTS)


def _slope_around(cell: Index, height: Float, grid: Grid) -> tuple[Float, Float]:
    return gradient_at(cell, [(cell, height)], grid, reach=_NEIGHBOURHOOD_M)


def cell_statistics(xyz: Float, grid: Grid, *, plane: bool = False, least: int = 4) -> CellStatistics:
    """Count, height and variance of the points (n, 3) of each cell.

    Args:
        plane: fit z = a + b x + c y in each cell and take its value at the cell's centre, rather than the mean. It
            removes the error that uneven sampling of a sloping cell brings. Cells with fewer than ``least``
            points, or whose points lie nearly on a line, keep the mean.
        least: at least four.
    """
    points = _points_in_cells(xyz, grid, _level(xyz, grid))
    return _statistics(_sums(points, spread=plane), grid, least=least if plane else None)


@dataclass(frozen=True)
class _Points:
    """Points inside the grid: metres east (u) and north (v) of their cell's centre, heights about ``level``.

    ``cell`` is the flat index of the cells that have any, ``n`` how many these have, and ``number`` the place in both
    of each point's cell.
    """

    u: Float
    v: Float
    z: Float
    level: float
    n: NDArray[np.int64]
    cell: NDArray[np.int64]
    number: NDArray[np.int64]


@dataclass(frozen=True)
class _Sums:
    """Mean height of the points of each cell that has any, and the sums of products about their means, arrays (cells,).

    Heights are about ``level``. ``n`` is how many points each cell has. ``u`` and ``v`` are their mean place from the
    cell's centre; zeros, as the products with them, where these were not asked for.
    """

    level: float
    cell: NDArray[np.int64]
    n: NDArray[np.int64]
    height: Float
    zz: Float
    u: Float
    v: Float
    uu: Float
    vv: Float
    uv: Float
    uz: Float
    vz: Float


def _level(xyz: Float, grid: Grid) -> float:
    """See ``median_level``."""
    return median_level(lambda: [xyz], grid)


def median_level(parts: Callable[[], Iterable[Float]], grid: Grid) -> float:
    """Median height (m) of some points evenly among those of a cloud within a grid, given part by part (n, 3)."""

    def inside() -> Iterator[Float]:
        for xyz in parts():
            outside = _outside(*_row_and_column(xyz, grid), grid)
            yield xyz if outside is None else xyz[~outside]

    count = sum(len(xyz) for xyz in inside())
    step, done, some = max(1, count // _LEVEL_POINTS), 0, [np.zeros(0)]
    for xyz in inside():
        some.append(xyz[-done % step :: step, 2])
        done += len(xyz)
    return float(np.median(np.concatenate(some))) if count else 0.0


def _points_in_cells(xyz: Float, grid: Grid, level: float) -> _Points:
    """Heights are about ``level``: squares of small numbers keep their digits."""
    row, column = _row_and_column(xyz, grid)
    outside = _outside(row, column, grid)
    if outside is not None:
        inside = ~outside
        xyz, row, column = xyz[inside], row[inside], column[inside]
    index = (row * grid.columns + column).astype(np.int64)
    # of the rows that are reached only
    first = int(row.min()) * grid.columns if len(row) else 0
    count = np.bincount(index - first, minlength=1)
    here = np.flatnonzero(count > 0)
    number = np.empty(count.size, dtype=np.int64)
    number[here] = np.arange(here.size)
    return _Points(
        u=xyz[:, 0] - (grid.west + (column + 0.5) * grid.cell),
        v=xyz[:, 1] - (grid.north - (row + 0.5) * grid.cell),
        z=xyz[:, 2] - level,
        level=level,
        n=count[here],
        cell=here + first,
        number=number[index - first],
    )


def _sums(points: _Points, *, spread: bool) -> _Sums:
    n = points.n

    def total(values: Float) -> Float:
        return np.bincount(points.number, weights=values, minlength=n.size).astype(np.float64, copy=False)

    height = total(points.z) / n
    dz = points.z - height[points.number]
    zz = total(dz * dz)
    if not spread:
        zero = np.zeros(n.size)
        return _Sums(points.level, points.cell, n, height, zz, zero, zero, zero, zero, zero, zero, zero)
    u, v = total(points.u) / n, total(points.v) / n
    # places are small numbers already, and the heights' differences from their mean add up to nothing
    uu, vv, uv, uz, vz = (
        total(a * b)
        for a, b in ((points.u, points.u), (points.v, points.v), (points.u, points.v), (points.u, dz), (points.v, dz))
    )
    return _Sums(
        points.level,
        points.cell,
        n,
        height,
        zz,
        u,
        v,
        uu - n * u * u,
        vv - n * v * v,
        uv - n * u * v,
        uz,
        vz,
    )


def _without_slope(cells: _Sums, east: Float, north: Float) -> _Sums:
    """The sums as they would be had z - east u - north v been summed in place of z (both (cells,))."""
    rise_u, rise_v = east * cells.uu + north * cells.uv, east * cells.uv + north * cells.vv
    zz = cells.zz - 2.0 * (east * cells.uz + north * cells.vz) + east * rise_u + north * rise_v
    return replace(
        cells,
        height=cells.height - east * cells.u - north * cells.v,
        zz=np.maximum(zz, 0.0),
        uz=cells.uz - rise_u,
        vz=cells.vz - rise_v,
    )


def _statistics(cells: _Sums, grid: Grid, *, least: int | None) -> CellStatistics:
    """Of means, or of planes in the cells with ``least`` points whose spread determines one."""
    n = cells.n.astype(np.float64)
    height, squares, degrees, leverage = cells.height + cells.level, cells.zz.copy(), n - 1.0, 1.0 / n
    tilted = np.zeros(cells.n.size, dtype=bool)
    scatter = _ratio(squares, degrees)
    if least is not None:
        chosen, fall, rest, extrapolation = _planes(cells, grid.cell, least)
        tilted[chosen] = True
        height[chosen] -= fall
        squares[chosen] = rest
        degrees[chosen] -= 2.0
        leverage[chosen] += extrapolation
    variance = _ratio(squares, degrees)
    count = on_grid(cells.cell, cells.n, grid.shape, 0)
    return CellStatistics(count, cells.cell, height, variance, degrees, leverage, tilted, scatter)


def _ratio(squares: Float, degrees: Float) -> Float:
    """NaN without a degree of freedom."""
    return squares / np.where(degrees > 0, degrees, np.nan)


def _planes(cells: _Sums, side: float, least: int) -> tuple[NDArray[np.int64], Float, Float, Float]:
    """Which cells follow a plane of their own, by least squares in the centred sums.

    And of each: how much lower it is at the cell's centre than its points' mean, its residual squares, and by how much
    its leverage exceeds that of the mean, (X'X)^-1_00 - 1/n.
    """
    may = np.flatnonzero(cells.n >= max(least, 4))
    n, u, v = cells.n[may], cells.u[may], cells.v[may]
    uu, vv, uv, uz, vz = (sums[may] for sums in (cells.uu, cells.vv, cells.uv, cells.uz, cells.vz))
    rise_u, rise_v, determinant = gradient_parts(uu, vv, uv, uz, vz)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope_u, slope_v = rise_u / determinant, rise_v / determinant
        extrapolation = (u**2 * vv - 2 * u * v * uv + v**2 * uu) / determinant
    # a spread of at least a tenth of the cell in every direction; else the plane tilts freely
    enough = (determinant > 1e-4 * (n * side**2 / 12.0) ** 2) & (extrapolation < 1.0)
    chosen = may[enough]
    slope_u, slope_v, u, v, uz, vz = (values[enough] for values in (slope_u, slope_v, u, v, uz, vz))
    rest = np.maximum(cells.zz[chosen] - slope_u * uz - slope_v * vz, 0.0)
    return chosen, slope_u * u + slope_v * v, rest, extrapolation[enough]


def _cell_sums_by_numpy(
    xyz: Float, frame: cell_kernels.Frame, shape: tuple[int, int], level: float
) -> tuple[Index, Float]:
    grid = Grid(frame[0], frame[2], frame[3], *shape)
    of = _sums(_points_in_cells(xyz, grid, level), spread=True)
    count = on_grid(of.cell, of.n, shape, 0).ravel()
    return count, np.array([of.height, of.zz, of.u, of.v, of.uu, of.vv, of.uv, of.uz, of.vz])


def _cell_values_by_numpy(sums: Float, n: Index, gradient: Float, numbers: tuple[float, float, int]) -> Float:
    level, square, least = numbers
    height, zz, *others = sums
    row = Grid(0.0, 0.0, float(np.sqrt(square)), 1, n.size)  # of the cells, one next to the other
    cells = _without_slope(_Sums(level, np.arange(n.size), n, height, zz, *others), *np.nan_to_num(gradient))
    of = _statistics(cells, row, least=least)
    return np.array([of.height, of.variance, of.degrees, of.leverage, of.tilted.astype(np.float64), of.scatter])


_cell_sums = compiled(_cell_sums_by_numpy, *cell_kernels.HELPERS)(cell_kernels.cell_sums)
_cell_values = compiled(_cell_values_by_numpy)(cell_kernels.cell_values)
