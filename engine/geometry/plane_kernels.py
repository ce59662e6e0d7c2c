"""What ``plane_cells`` does for each point or cell, in loops that numba compiles, and by numpy with the same result."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Bool, Float, Index
from ..core.compiled import compiled

Pool = tuple[float, float, float]


def _product_sums_by_numpy(key: Index, x: Float, y: Float, z: Float, weight: Float, count: int) -> Float:
    wx, wy, wz = weight * x, weight * y, weight * z
    products = (weight, wx, wy, wx * x, wx * y, wy * y, wz, wz * x, wz * y)
    return np.vstack([np.bincount(key, values, count) for values in products])


@compiled(_product_sums_by_numpy)
def product_sums(key: Index, x: Float, y: Float, z: Float, weight: Float, count: int) -> Float:
    """(9, count) sums of w, wx, wy, wxx, wxy, wyy, wz, wzx, wzy over the points (n,) of each of ``count`` cells.

    ``key`` (n,) is the points' cell, from 0 to ``count`` - 1; a point outside is an IndexError.
    """
    sums = np.zeros((count, 9))
    for i in range(len(key)):
        k = key[i]
        if k < 0 or k >= count:
            raise IndexError
        w = weight[i]
        wx, wy, wz = w * x[i], w * y[i], w * z[i]
        sums[k, 0] += w
        sums[k, 1] += wx
        sums[k, 2] += wy
        sums[k, 3] += wx * x[i]
        sums[k, 4] += wx * y[i]
        sums[k, 5] += wy * y[i]
        sums[k, 6] += wz
        sums[k, 7] += wz * x[i]
        sums[k, 8] += wz * y[i]
    return sums.T.copy()


def _power_sums_by_numpy(key: Index, values: Float, chosen: Bool, count: int) -> Float:
    key, values = key[chosen], values[chosen]
    square = values * values
    powers = (None, values, square, square * values, square * square)
    return np.vstack([np.bincount(key, power, count).astype(np.float64) for power in powers])


@compiled(_power_sums_by_numpy)
def power_sums(key: Index, values: Float, chosen: Bool, count: int) -> Float:
    """(5, count) number and sums of the first to fourth powers of the ``chosen`` values (n,) of each cell."""
    sums = np.zeros((count, 5))
    for i in range(len(key)):
        if not chosen[i]:
            continue
        k = key[i]
        if k < 0 or k >= count:
            raise IndexError
        value = values[i]
        square = value * value
        sums[k, 0] += 1.0
        sums[k, 1] += value
        sums[k, 2] += square
        sums[k, 3] += square * value
        sums[k, 4] += square * square
    return sums.T.copy()


def _moved_sums_by_numpy(sums: Float, pool: Pool) -> Float:
    before, centre, behind = pool
    pooled = centre * sums
    for u, to, of in ((-1.0, np.s_[1:], np.s_[:-1]), (1.0, np.s_[:-1], np.s_[1:])):
        w, sx, sy, sxx, sxy, syy, sz, sxz, syz = sums[:, of]
        parts = (w, sx + u * w, sy, sxx + 2 * u * sx + w, sxy + u * sy, syy, sz, sxz + u * sz, syz)
        for total, part in zip(pooled, parts, strict=True):
            total[to] += before * part
    sums, pooled = pooled, centre * pooled
    for v, right, left in ((-1.0, np.s_[:, 1:], np.s_[:, :-1]), (1.0, np.s_[:, :-1], np.s_[:, 1:])):
        w, sx, sy, sxx, sxy, syy, sz, sxz, syz = (s[left] for s in sums)
        parts = (w, sx, sy + v * w, sxx, sxy + v * sx, syy + 2 * v * sy + w, sz, sxz, syz + v * sz)
        for total, part in zip(pooled, parts, strict=True):
            total[right] += behind * part
    return pooled


@compiled(_moved_sums_by_numpy)
def moved_sums(sums: Float, pool: Pool) -> Float:
    """Sums (9, rows, columns) of ``product_sums`` over the cells around, moved to each cell's middle.

    First along the rows' axis, then across; ``pool`` are the weights of a cell before, of itself and behind.
    """
    before, centre, behind = pool
    _, rows, columns = sums.shape
    along = np.empty(sums.shape)
    for i in range(rows):
        for j in range(columns):
            for n in range(9):
                along[n, i, j] = centre * sums[n, i, j]
            for u in (-1.0, 1.0):
                o = i + int(u)
                if o < 0 or o >= rows:
                    continue
                w, sx, sy, sz = sums[0, o, j], sums[1, o, j], sums[2, o, j], sums[6, o, j]
                along[0, i, j] += before * w
                along[1, i, j] += before * (sx + u * w)
                along[2, i, j] += before * sy
                along[3, i, j] += before * (sums[3, o, j] + 2 * u * sx + w)
                along[4, i, j] += before * (sums[4, o, j] + u * sy)
                along[5, i, j] += before * sums[5, o, j]
                along[6, i, j] += before * sz
                along[7, i, j] += before * (sums[7, o, j] + u * sz)
                along[8, i, j] += before * sums[8, o, j]
    pooled = np.empty(sums.shape)
    for i in range(rows):
        for j in range(columns):
            for n in range(9):
                pooled[n, i, j] = centre * along[n, i, j]
            for v in (-1.0, 1.0):
                o = j + int(v)
                if o < 0 or o >= columns:
                    continue
                w, sx, sy, sz = along[0, i, o], along[1, i, o], along[2, i, o], along[6, i, o]
                pooled[0, i, j] += behind * w
                pooled[1, i, j] += behind * sx
                pooled[2, i, j] += behind * (sy + v * w)
                pooled[3, i, j] += behind * along[3, i, o]
                pooled[4, i, j] += behind * (along[4, i, o] + v * sx)
                pooled[5, i, j] += behind * (along[5, i, o] + 2 * v * sy + w)
                pooled[6, i, j] += behind * sz
                pooled[7, i, j] += behind * along[7, i, o]
                pooled[8, i, j] += behind * (along[8, i, o] + v * sz)
    return pooled


def _heights_by_numpy(key: Index, x: Float, y: Float, height: Float, along: Float, across: Float) -> Float:
    return np.asarray(height[key] + along[key] * x + across[key] * y)


@compiled(_heights_by_numpy)
def plane_heights(key: Index, x: Float, y: Float, height: Float, along: Float, across: Float) -> Float:
    """(n,) height of the planes of the cells ``key`` (n,), with values (cells,), at places (n,) in them."""
    found = np.empty(len(key))
    for i in range(len(key)):
        k = key[i]
        if k < 0 or k >= len(height):
            raise IndexError
        found[i] = height[k] + along[k] * x[i] + across[k] * y[i]
    return found
