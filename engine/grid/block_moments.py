"""Sums of the points in square blocks from which any larger block's plane follows, without the points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..geometry.plane_gradient import gradient_parts
from .grid import Grid, cell_index

# Rows of Moments.sums.
N, U, V, Z, UU, UV, VV, UZ, VZ, ZZ = range(10)
PLAIN_SUMS = 10
"""How many of them there are; behind come the sums of what else is known of the points."""
# A spread of the points of at least a tenth of the block in every direction; else a plane tilts freely.
_MIN_SPREAD_RATIO = 1e-4
_BLOCKS_AT_ONCE = 20_000  # blocks, whose figures fit a cache


@dataclass(frozen=True)
class Moments:
    """Sums over the points of each block, ``sums`` of shape (10 + k, rows, columns).

    The first ten are n, u, v, z, uu, uv, vv, uz, vz, zz: u (east) and v (north) are in metres from the block's own
    centre, z in metres from a common level. Behind are the sums of k more values that were given of each point.
    ``side`` is the blocks' side in metres.
    """

    sums: Float
    side: float

    @property
    def count(self) -> Float:
        return self.sums[N]

    @property
    def shape(self) -> tuple[int, int]:
        return self.sums.shape[1], self.sums.shape[2]

    @property
    def more(self) -> int:
        """How many further values are known of each point."""
        return len(self.sums) - PLAIN_SUMS

    def mean(self, more: int) -> Float:
        """Mean of a value that was given in addition to the coordinates, by its number from 0; NaN without points."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.sums[PLAIN_SUMS + more] / self.sums[N])


@dataclass(frozen=True)
class ParallelPlanes:
    """Two parallel planes, one an epoch, through the points of each block; arrays (rows, columns).

    Attributes:
        dz: height of the second plane over the first, m.
        slope_u, slope_v: their common gradient.
        squares: residual squares of the first and the second epoch's points, m².
        degrees: degrees of freedom left to each epoch's points.
        weights: the variance of ``dz`` is weights[0] * var_1 + weights[1] * var_2, var the variance of a point.
        centres: mean u, v and z of either epoch's points.
        sound: where the gradient is determined and the epochs' centres are not too far apart for it.
    """

    dz: Float
    slope_u: Float
    slope_v: Float
    squares: tuple[Float, Float]
    degrees: tuple[Float, Float]
    weights: tuple[Float, Float]
    centres: tuple[tuple[Float, Float, Float], tuple[Float, Float, Float]]
    sound: NDArray[np.bool_]


def cell_moments(xyz: Float, grid: Grid, level: float, more: Sequence[NDArray[np.floating]] = ()) -> Moments:
    """Moments of the points (n, 3) in the cells of ``grid``, heights from ``level``, and of ``more`` values (n,)."""
    cell, listed = listed_moments(xyz, grid, level, more)
    sums = np.zeros((len(listed), grid.rows * grid.columns))
    sums[:, cell] = listed
    return Moments(sums.reshape(len(listed), *grid.shape), grid.cell)


def listed_moments(
    xyz: Float, grid: Grid, level: float, more: Sequence[NDArray[np.floating]] = ()
) -> tuple[Index, Float]:
    """As ``cell_moments``, of the cells with points alone: flat indices (n,), ascending, and sums (10 + k, n)."""
    index = cell_index(xyz, grid)
    if index.size and index.min() < 0:
        inside = index >= 0
        index, xyz, more = index[inside], xyz[inside], [values[inside] for values in more]
    row, column = np.divmod(index, grid.columns)
    u = xyz[:, 0] - (grid.west + (column + 0.5) * grid.cell)
    v = xyz[:, 1] - (grid.north - (row + 0.5) * grid.cell)
    z = xyz[:, 2] - level
    # of the rows that are reached only
    first = int(row.min(initial=grid.rows)) * grid.columns
    count = np.bincount(index - first)
    here = np.flatnonzero(count)
    place = np.empty(count.size, dtype=np.int64)
    place[here] = np.arange(here.size)
    place = place[index - first]
    sums = np.empty((PLAIN_SUMS + len(more), here.size))
    for number, values in enumerate((None, u, v, z, u * u, u * v, v * v, u * z, v * z, z * z, *more)):
        sums[number] = np.bincount(place, weights=values, minlength=here.size)
    return here + first, sums


def merged(moments: Moments) -> Moments:
    """Moments of the blocks of two by two; both sides of the array must be even."""
    quarter = moments.side / 2
    total = np.zeros((len(moments.sums), moments.shape[0] // 2, moments.shape[1] // 2))
    for i, dv in ((0, quarter), (1, -quarter)):  # row 0 is the northern one
        for j, du in ((0, -quarter), (1, quarter)):
            n, u, v, z, uu, uv, vv, uz, vz, zz = moments.sums[:PLAIN_SUMS, i::2, j::2]
            total[N] += n
            total[U] += u + n * du
            total[V] += v + n * dv
            total[Z] += z
            total[UU] += uu + 2 * du * u + n * du**2
            total[UV] += uv + du * v + dv * u + n * du * dv
            total[VV] += vv + 2 * dv * v + n * dv**2
            total[UZ] += uz + du * z
            total[VZ] += vz + dv * z
            total[ZZ] += zz
            total[PLAIN_SUMS:] += moments.sums[PLAIN_SUMS:, i::2, j::2]
    return Moments(total, 2 * moments.side)


def parallel_planes(first: Moments, second: Moments) -> ParallelPlanes:
    """Least squares of z = a + g . (u, v) in the first epoch and z = a + dz + g . (u, v) in the second, block by block.

    One gradient for both epochs: where they sample different places of a sloping surface, both are brought to the same
    place, by all points that there are (analysis of covariance; Cox and Hinkley 1974, Theoretical Statistics).
    """
    rows, columns = first.shape
    found = np.empty((15, rows, columns))
    sound = np.empty((rows, columns), dtype=bool)
    step = max(1, _BLOCKS_AT_ONCE // columns)
    for top in range(0, rows, step):
        part = slice(top, top + step)
        _fit_planes(first.sums[:, part], second.sums[:, part], first.side, found[:, part], sound[part])
    dz, slope_u, slope_v, square_1, square_2, degree_1, degree_2, weight_1, weight_2, *centres = found
    return ParallelPlanes(
        dz=dz,
        slope_u=slope_u,
        slope_v=slope_v,
        squares=(square_1, square_2),
        degrees=(degree_1, degree_2),
        weights=(weight_1, weight_2),
        centres=((centres[0], centres[1], centres[2]), (centres[3], centres[4], centres[5])),
        sound=sound,
    )


def _fit_planes(first: Float, second: Float, side: float, found: Float, sound: NDArray[np.bool_]) -> None:
    """Planes of the blocks with the sums ``first`` and ``second``, into ``found`` (15, rows, columns) and ``sound``."""
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b = _centred(first), _centred(second)
        suu, svv, suv = a.uu + b.uu, a.vv + b.vv, a.uv + b.uv
        rise_u, rise_v, determinant = gradient_parts(suu, svv, suv, a.uz + b.uz, a.vz + b.vz)
        slope_u, slope_v = rise_u / determinant, rise_v / determinant
        apart_u, apart_v = b.u - a.u, b.v - a.v
        found[0] = b.z - a.z - slope_u * apart_u - slope_v * apart_v
        found[1], found[2] = slope_u, slope_v
        # S^-1 times the way between the two centres: how the gradient's error reaches dz
        lever_u, lever_v, _ = gradient_parts(suu, svv, suv, apart_u, apart_v)
        lever_u, lever_v = lever_u / determinant, lever_v / determinant
        for epoch, e in enumerate((a, b)):
            rest = e.zz - 2 * (slope_u * e.uz + slope_v * e.vz)
            rest += slope_u**2 * e.uu + 2 * slope_u * slope_v * e.uv + slope_v**2 * e.vv
            np.maximum(rest, 0.0, out=found[3 + epoch])
            spent = (svv * e.uu - 2 * suv * e.uv + suu * e.vv) / determinant  # of the two numbers of the gradient
            np.maximum(e.n - 1 - spent, 0.0, out=found[5 + epoch])
            found[7 + epoch] = 1 / e.n + lever_u**2 * e.uu + 2 * lever_u * lever_v * e.uv + lever_v**2 * e.vv
            found[9 + 3 * epoch], found[10 + 3 * epoch], found[11 + 3 * epoch] = e.u, e.v, e.z
        extrapolation = lever_u * apart_u + lever_v * apart_v
        n = a.n + b.n
        sound[:] = (a.n > 0) & (b.n > 0) & (n >= 4) & (extrapolation < 1.0)
        sound &= determinant > _MIN_SPREAD_RATIO * (n * side**2 / 12.0) ** 2
    found[:9, ~sound] = np.nan


def variance_by_parts(planes: ParallelPlanes, blocks: list[Moments], parts: list[Moments]) -> tuple[Float, Float]:
    """Variance of the blocks' dz, estimated from the sums of residuals in their parts, and the number of parts with
    points.

    Where the errors of near points are alike, as under a shrub that was taken for ground, the mean of n points is less
    certain than n independent ones would be. With R the sum of an epoch's residuals in a part and N its points in the
    block, the variance is the sum over the parts of (R_2 / N_2 - R_1 / N_1)² (Liang and Zeger 1986,
    doi:10.1093/biomet/73.1.13). The surface's own shape, alike in both epochs, cancels as far as both sample it alike.

    Args:
        blocks, parts: moments of both epochs, of the blocks and of the smaller squares that they are made of.
    """
    multiple = round(blocks[0].side / parts[0].side)
    side = parts[0].side
    variance, number = np.zeros(planes.dz.shape), np.zeros(planes.dz.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        for i, j in np.ndindex(multiple, multiple):
            east, north = (j - (multiple - 1) / 2) * side, ((multiple - 1) / 2 - i) * side
            means = []
            for block, part, (u, v, z) in zip(blocks, parts, planes.centres, strict=True):
                n, *sums = part.sums[:4, i::multiple, j::multiple]
                rest = sums[2] - n * z
                rest -= planes.slope_u * (sums[0] + n * (east - u)) + planes.slope_v * (sums[1] + n * (north - v))
                means.append(rest / block.count)
            variance += (means[1] - means[0]) ** 2
            number += (parts[0].sums[N, i::multiple, j::multiple] > 0) | (
                parts[1].sums[N, i::multiple, j::multiple] > 0
            )
    return variance, number


@dataclass(frozen=True)
class _Centred:
    """Means, and sums of products about them."""

    n: Float
    u: Float
    v: Float
    z: Float
    uu: Float
    uv: Float
    vv: Float
    uz: Float
    vz: Float
    zz: Float


def _centred(sums: Float) -> _Centred:
    n, u, v, z, uu, uv, vv, uz, vz, zz = sums[:PLAIN_SUMS]
    mu, mv, mz = u / n, v / n, z / n
    return _Centred(
        n, mu, mv, mz, uu - u * mu, uv - u * mv, vv - v * mv, uz - u * mz, vz - v * mz, np.maximum(zz - z * mz, 0.0)
    )
