"""Sums of the points of each cell, and the cells' heights of them, as loops that numba compiles.

They add and multiply in the order of ``cell_statistics``, which has numpy's way of each.
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float, Index

Frame = tuple[float, float, float, float, float]
"""West, south and north of a grid, the side of its cells, and how many of them there are to a metre."""


def sorted_points(sorted_: Float, xyz: Float, frame: Frame, shape: tuple[int, int], level: float) -> Index:
    """How many of the points (n, 3) each cell of a grid has (rows * columns,).

    ``sorted_`` (n, 3) becomes their places east and north of their cell's centre and their heights about ``level``,
    cell by cell, in the order of the points.
    """
    west, south, north, side, scale = frame
    rows, columns = shape
    count, cell = np.zeros(rows * columns, np.int32), np.empty(len(xyz), np.int32)
    for i in range(len(xyz)):
        column = np.floor((xyz[i, 0] - west) * scale + 1e-6)
        row = (rows - 1) - np.floor((xyz[i, 1] - south) * scale + 1e-6)
        cell[i] = -1
        if column >= 0 and column < columns and row >= 0 and row < rows:
            cell[i] = int(row * columns + column)
            count[cell[i]] += 1
    found, place, before = np.empty(count.size, np.int64), np.empty(count.size, np.int32), 0
    for k in range(count.size):
        found[k], place[k] = count[k], before
        before += count[k]
    for i in range(len(xyz)):
        if cell[i] >= 0:
            column = np.floor((xyz[i, 0] - west) * scale + 1e-6)
            row = (rows - 1) - np.floor((xyz[i, 1] - south) * scale + 1e-6)
            to = sorted_[place[cell[i]]]
            to[0] = xyz[i, 0] - (west + (column + 0.5) * side)
            to[1] = xyz[i, 1] - (north - (row + 0.5) * side)
            to[2] = xyz[i, 2] - level
            place[cell[i]] += 1
    return found


def cell_sums(xyz: Float, frame: Frame, shape: tuple[int, int], level: float) -> tuple[Index, Float]:
    """How many of the points (n, 3) each cell of a grid has (rows * columns,), and sums (9, cells) of those with any.

    Mean height about ``level``, squares about it, mean place east and north of the cell's centre, and the sums of
    products about these: east east, north north, east north, east height, north height. Points outside do not count.
    """
    points = np.empty((len(xyz), 3))
    count = sorted_points(points, xyz, frame, shape, level)
    held = count[count > 0]
    found, first = np.empty((9, held.size)), 0
    for k in range(held.size):
        n = held[k]
        own, z, u, v = points[first : first + n], 0.0, 0.0, 0.0
        for i in range(n):
            u, v, z = u + own[i, 0], v + own[i, 1], z + own[i, 2]
        u, v, z = u / n, v / n, z / n
        zz, uu, vv, uv, uz, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            one, other, dz = own[i, 0], own[i, 1], own[i, 2] - z
            zz, uu, vv = zz + dz * dz, uu + one * one, vv + other * other
            uv, uz, vz = uv + one * other, uz + one * dz, vz + other * dz
        found[0, k], found[1, k], found[2, k], found[3, k] = z, zz, u, v
        found[4, k], found[5, k], found[6, k] = uu - n * u * u, vv - n * v * v, uv - n * u * v
        found[7, k], found[8, k] = uz, vz
        first += n
    return count, found


def cell_values(sums: Float, n: Index, gradient: Float, numbers: tuple[float, float, int]) -> Float:
    """(6, cells) height, variance of the points, its degrees of freedom, leverage, 1 where a plane gives the height,
    and variance about the mean, as ``cell_statistics.CellStatistics`` describes them.

    Args:
        sums: (9, cells) as ``cell_sums``.
        n: (cells,) how many points each has.
        gradient: (2, cells) rise east and north that is taken off the points before; NaN: none is.
        numbers: level that heights are about, a cell's area, points from which a cell has a plane.
    """
    level, square, least = numbers
    found = np.empty((6, n.size))
    for k in range(n.size):
        east = 0.0 if np.isnan(gradient[0, k]) else gradient[0, k]
        north = 0.0 if np.isnan(gradient[1, k]) else gradient[1, k]
        u, v, uu, vv, uv = sums[2, k], sums[3, k], sums[4, k], sums[5, k], sums[6, k]
        rise_u, rise_v = east * uu + north * uv, east * uv + north * vv
        squares = sums[1, k] - 2.0 * (east * sums[7, k] + north * sums[8, k]) + east * rise_u + north * rise_v
        squares = max(squares, 0.0)
        height = (sums[0, k] - east * u - north * v) + level
        uz, vz = sums[7, k] - rise_u, sums[8, k] - rise_v
        degrees, leverage, tilted = float(n[k]) - 1.0, 1.0 / float(n[k]), 0.0
        found[5, k] = squares / degrees if degrees > 0 else np.nan
        if n[k] >= least:
            determinant = uu * vv - uv * uv
            room = n[k] * square / 12.0
            if determinant > 1e-4 * (room * room):
                further = (u * u * vv - 2 * u * v * uv + v * v * uu) / determinant
                if further < 1.0:
                    slope_u, slope_v = (uz * vv - vz * uv) / determinant, (vz * uu - uz * uv) / determinant
                    height -= slope_u * u + slope_v * v
                    squares = max(squares - slope_u * uz - slope_v * vz, 0.0)
                    degrees, leverage, tilted = degrees - 2.0, leverage + further, 1.0
        found[0, k], found[2, k], found[3, k], found[4, k] = height, degrees, leverage, tilted
        found[1, k] = squares / degrees if degrees > 0 else np.nan
    return found


HELPERS = (sorted_points,)
"""Of the first loop."""
