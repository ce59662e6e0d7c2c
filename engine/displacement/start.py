"""Where least squares begin: the shift of best masked correlation. It is good enough for a start, not for an answer."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ..core.arrays import Float, Index
from .surface import NODE_M

NODES = 5
"""Nodes of the surface's grid by a side of the correlation's cells."""
CELL_M = NODES * NODE_M
_DETREND_M = 1.0  # standard deviation of what is taken off as shape
_MIN_KNOWN_SHARE = 0.3  # of a cell's nodes
_MIN_COMMON_SHARE = 0.25  # of a window's cells that both see
_EPSILON = 1e-12


def relief(values: Float) -> Float:
    """(rows, columns) mean heights of the coarser cells without the surface's shape; NaN where unknown."""
    height, width = (n // NODES * NODES for n in values.shape[1:])
    parts = values[0, :height, :width].reshape(height // NODES, NODES, width // NODES, NODES)
    known = np.isfinite(parts)
    count = known.sum(axis=(1, 3))
    mean = np.where(known, parts, 0.0).sum(axis=(1, 3)) / np.maximum(count, 1)
    seen = count >= _MIN_KNOWN_SHARE * NODES**2
    sigma = _DETREND_M / CELL_M
    weight = ndimage.gaussian_filter(seen.astype(np.float64), sigma, mode="constant")
    base = float(mean[seen].mean()) if seen.any() else 0.0
    smooth = ndimage.gaussian_filter(np.where(seen, mean - base, 0.0), sigma, mode="constant")
    return np.where(seen, mean - base - smooth / np.maximum(weight, _EPSILON), np.nan)


def best_shifts(first: Float, later: Float, middles: Index, radius: float, limit: float) -> tuple[Float, Float]:
    """The shift of ``later`` against ``first`` (rows, columns of ``relief``) that correlates best in square windows.

    Args:
        middles: (n, 2) row and column of the windows' middles in these cells.
        radius: half a window's side, metres.
        limit: largest shift along either axis, metres.

    Returns:
        (n, 2) shifts in metres and (n,) their correlations; 0 and -1 where too little is common.
    """
    reach = max(int(np.ceil(limit / CELL_M)), 1)
    half = max(round(radius / CELL_M), 1)
    shape = first.shape
    known = [np.isfinite(v) for v in (first, later)]
    a, b = (np.where(k, v, 0.0) for k, v in zip(known, (first, later), strict=True))
    mask_a, mask_b = (k.astype(np.float64) for k in known)
    low = np.clip(middles - half, 0, shape)
    high = np.clip(middles + half + 1, 0, shape)
    best, where = np.full(len(middles), -1.0), np.zeros((len(middles), 2))
    least = _MIN_COMMON_SHARE * (2 * half + 1) ** 2
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            to = (slice(max(-i, 0), shape[0] - max(i, 0)), slice(max(-j, 0), shape[1] - max(j, 0)))
            of = (slice(max(i, 0), shape[0] - max(-i, 0)), slice(max(j, 0), shape[1] - max(-j, 0)))
            both = mask_a[to] * mask_b[of]
            count, aa, bb, ab = (
                _window_sums(values, shape, to, low, high)
                for values in (both, a[to] ** 2 * both, b[of] ** 2 * both, a[to] * b[of])
            )
            correlation = np.where(count >= least, ab / np.sqrt(np.maximum(aa * bb, _EPSILON)), -1.0)
            better = correlation > best + _EPSILON
            best[better], where[better] = correlation[better], (i * CELL_M, j * CELL_M)
    return where, best


def _window_sums(values: Float, shape: tuple[int, ...], to: tuple[slice, slice], low: Index, high: Index) -> Float:
    table = np.zeros((shape[0] + 1, shape[1] + 1))
    table[1:, 1:][to] = values
    np.cumsum(table, axis=0, out=table)
    np.cumsum(table, axis=1, out=table)
    return np.asarray(
        table[high[:, 0], high[:, 1]]
        - table[low[:, 0], high[:, 1]]
        - table[high[:, 0], low[:, 1]]
        + table[low[:, 0], low[:, 1]]
    )
