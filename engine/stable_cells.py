"""Cells of a difference that did not change, found from the difference itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .cell_slope import Float

REACH = 0.5  # metres around a cell over which a change is looked for as a whole
_LEAST_REACH = 2  # ... and cells
BEYOND = 5.0  # robust standard deviations of the local means, beyond which a place has moved
CLIP = 4.0  # one wild cell is not a moved place
ROUNDS = 20
_CLASS = 5.0  # degrees
_FEWEST = 200  # differences of neighbours in a class of slope


def find_stable(dz: Float, error: Float, slope: Float, cell: float) -> NDArray[np.bool_]:
    """Cells (rows, columns) that are not part of a coherent change, nor beside one.

    Noise differs from cell to cell, a change is alike in many. So the mean of dz / error over the cells within half a
    metre, times the square root of their number, is small on stable ground and large where it moved. How large is told
    by the robust scatter of these means over all cells that are still taken as stable, which includes errors that are
    correlated over some cells; those beyond 5 times it, and the cells around them, are left out, and the scatter
    taken again until nothing changes. The scatter is a median, so that change of 30 % of the cells is found. Errors
    are first scaled by slope with the differences of adjacent cells, which a change, being coherent, hardly touches.

    Args:
        dz: change, metres; NaN where unknown.
        error: its standard error before calibration, metres.
        slope: degrees; NaN where unknown.
        cell: side of a cell, metres.
    """
    known = np.isfinite(dz) & np.isfinite(error) & (error > 0)
    if not known.any():
        return known
    z = np.where(known, dz, 0.0) / np.where(known, error, 1.0)
    z = np.clip(z / adjacent_scatter(z, known, slope), -CLIP, CLIP)
    radius = max(_LEAST_REACH, round(REACH / cell))
    size = 2 * radius + 1
    number = ndimage.uniform_filter(known.astype(np.float64), size, mode="constant") * size**2
    total = ndimage.uniform_filter(np.where(known, z, 0.0), size, mode="constant") * size**2
    moved = np.where(known, np.abs(total) / np.sqrt(np.maximum(number, 1.0)), 0.0)
    stable = known
    for _ in range(ROUNDS):
        scatter = max(1.0, 1.4826 * float(np.median(moved[stable])))
        centres = known & (moved > BEYOND * scatter)
        left: NDArray[np.bool_] = known & ~ndimage.maximum_filter(centres, size=size)
        if not left.any() or np.array_equal(left, stable):
            return left
        stable = left
    return stable


def adjacent_scatter(z: Float, known: NDArray[np.bool_], slope: Float, block: NDArray[np.int64] | None = None) -> Float:
    """Scatter of z from cell to cell, by slope: the 90 % quantile of adjacent cells' differences, over the normal's.

    Cells of one ``block`` are not compared with each other.
    """
    found, where = [], []
    for axis, step in ((0, z.shape[1]), (1, 1)):
        both = np.zeros(z.shape, dtype=bool)
        first, second = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        both[first] = known[first] & known[second]
        if block is not None:
            both[first] &= block[first] != block[second]
        here = np.flatnonzero(both)
        found.append(np.abs(z.ravel()[here + step] - z.ravel()[here]) / np.sqrt(2.0))
        where.append(slope.ravel()[here])
    size, at = np.concatenate(found), np.concatenate(where)
    if size.size < _FEWEST:
        return np.ones(z.shape)
    whole = max(float(np.quantile(size, 0.9)) / 1.6449, 1e-6)
    centres, scatter = [], []
    for low in np.arange(0.0, 90.0, _CLASS):
        inside = size[(at >= low) & (at < low + _CLASS)]
        if inside.size >= _FEWEST:
            centres.append(low + _CLASS / 2)
            scatter.append(max(float(np.quantile(inside, 0.9)) / 1.6449, 0.1 * whole))
    if not centres:
        return np.full(z.shape, whole)
    result = np.full(z.shape, whole)
    told = known & ~np.isnan(slope)
    result[told] = np.interp(slope[told], centres, scatter)
    return result
