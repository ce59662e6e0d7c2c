"""Cells of a difference that did not change, found from the difference itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..grid.cell_slope import class_of_slope
from ..grid.part_windows import MIN_WINDOW_CELLS, PartWindows
from ..grid.partition import Partition
from ..statistics.layout import Layout, layout_of
from ..statistics.quantiles import sample_quantile
from ..statistics.robust import NORMALISED
from ..statistics.window_sums import Windows

_REACH_M = 0.5  # metres around a cell over which a change is looked for as a whole
_MAX_LOCAL_DEVIATIONS = 5.0  # robust standard deviations of the local means, beyond which a place has moved
_MAX_CELL_DEVIATIONS = 4.0  # one outlying cell is not a moved place
_MAX_SHARED_DEVIATIONS = 4.0 * _MAX_LOCAL_DEVIATIONS  # for changes whose error neighbours share
_MAX_ROUNDS = 20
_MAX_MEAN_DEVIATIONS = 4.0  # standard errors of one cell; two strips that were not registered: 3 on a quarter
_SLOPE_CLASS_DEG = 5.0  # degrees
_MAX_TABLE_CELLS = 16  # of the grid for each known cell: with more, cells are searched and not looked up in a table
_MIN_DIFFERENCES = 200  # differences of neighbours in a class of slope


def find_stable(
    dz: Float, error: Float, slope: Float, partition: Partition, alike: Float | None = None
) -> NDArray[np.bool_]:
    """Cells that are not part of a coherent change, nor adjacent to one.

    Noise differs from cell to cell, a change is alike in many. So the mean of dz / error over the cells within half a
    metre, times the square root of their number, is small on stable ground and large where it moved. How large is
    measured by the robust scatter of these means over all cells that are still taken as stable, which includes errors
    that are correlated over some cells; those beyond 5 times it, and the cells around them, are left out, and the
    scatter taken again until nothing changes. The scatter is a median, so that change of 30 % of the cells is found.
    Errors are first scaled by slope with the differences of adjacent cells, which a change, being coherent, hardly
    touches.

    Where cells grew, each part counts as one and is stable as a whole or not at all, and the windows hold it and its
    neighbours. Arrays are (rows, columns), or (n,) of the cells that ``partition`` lists.

    Args:
        dz: change, metres, one for all cells of a part; NaN where unknown.
        error: its standard error before calibration, metres.
        slope: degrees; NaN where unknown.
        partition: which cells are one.
        alike: a further error that neighbours share, metres: it does not average out in a mean.
    """
    known = partition.within(np.isfinite(dz) & np.isfinite(error) & (error > 0))
    here = np.flatnonzero(known)
    found = np.zeros(known.shape, dtype=bool)
    if not here.size:
        return found
    z = dz.ravel().take(here) / error.ravel().take(here)
    scatter_of_one = adjacent_scatter(z, here, slope, partition)
    z = z / scatter_of_one
    shared: Float | float = 0.0
    if alike is not None:
        z, shared = with_alike(z, alike.ravel().take(here) / (error.ravel().take(here) * scatter_of_one))
    windows = PartWindows(partition, here, _width(partition.cell))
    moved = _means_around(clipped(z, shared), shared, windows)
    one_each = partition.first_among(here)
    stable = left = np.ones(here.size, dtype=bool)
    for _ in range(_MAX_ROUNDS):
        scatter = max(1.0, NORMALISED * sample_quantile(moved[one_each][stable[one_each]], 0.5))
        left = ~windows.reached(moved > _MAX_LOCAL_DEVIATIONS * scatter)
        if not left.any() or np.array_equal(left, stable):
            break
        stable = left
    found.ravel()[here] = left
    return found


def _means_around(z: Float, shared: Float | float, windows: PartWindows) -> Float:
    """Magnitude of the mean of ``z`` (n,) in each window over its error, of which ``shared`` does not average out."""
    if isinstance(shared, float):
        total, number = windows.totals(z, np.ones(z.size, dtype=np.int32))
    else:
        total, own, common = windows.totals(z, 1.0 - shared**2, shared)
        number = own + common**2
    return np.asarray(np.abs(total) / np.sqrt(np.maximum(number, 1)))


def _width(cell: float) -> int:
    """Cells along the side of a window that reaches ``_REACH_M`` to all sides."""
    return 2 * round(_REACH_M / cell) + 1


def changed_cells(dz: Float, error: Float, cell: float, layout: Layout | None = None) -> NDArray[np.bool_]:
    """Cells around which the ground has changed as a whole, decided without any other ground.

    There the mean of dz / error over the cells within half a metre, single outliers clipped, is twice the level
    of one cell. Independent errors do not make that; such as neighbours share would have to be four times as large as
    stated on a third of the ground. Unlike ``find_stable`` it does not ask what most cells do, so it holds where most
    have moved.

    Args:
        dz: change, metres; NaN where unknown.
        error: its whole standard error before calibration, metres, that of the registration and the plants included.
        cell: side of a cell, metres.
        layout: of the arrays; all cells (rows, columns) by default.
    """
    layout = layout or layout_of(dz)
    known = np.isfinite(dz) & np.isfinite(error) & (error > 0)
    place = np.flatnonzero(known)
    here = layout.flat(place)
    z = np.clip(dz[known] / error[known], -2.0 * _MAX_MEAN_DEVIATIONS, 2.0 * _MAX_MEAN_DEVIATIONS)
    windows = Windows(here, layout.shape, max(_width(cell), MIN_WINDOW_CELLS) // 2)
    total, number = windows.totals(here, z, np.ones(here.size, dtype=np.int32))
    found = np.zeros(dz.shape, dtype=bool)
    found.ravel()[place] = np.abs(total / np.maximum(number, 1)) > _MAX_MEAN_DEVIATIONS
    return found


def with_alike(z: Float, ratio: Float) -> tuple[Float, Float]:
    """Changes over their whole error, and the share of it that neighbours have in common.

    Args:
        z: changes over their own error.
        ratio: the common error over the own one.
    """
    whole = np.hypot(1.0, ratio)
    return z / whole, ratio / whole


def clipped(z: Float, shared: Float | float) -> Float:
    """Scaled changes, clipped to _MAX_CELL_DEVIATIONS where errors are the cells' own, wider the more neighbours share.

    A mean of shared errors is no larger than one of them: clipped alike, it could not be beyond _MAX_LOCAL_DEVIATIONS.
    """
    limit = _MAX_CELL_DEVIATIONS + (_MAX_SHARED_DEVIATIONS - _MAX_CELL_DEVIATIONS) * shared
    return np.asarray(np.clip(z, -limit, limit), dtype=np.float64)


def _neighbours(flat: Index, step: int, layout: Layout) -> tuple[Index, Index]:
    """Which of the cells ``flat`` (n,), ascending, have that ``step`` cells on, in the same row or below, and these."""
    if step == 1:
        pair = np.flatnonzero((np.diff(flat) == 1) & (flat[1:] % layout.shape[1] != 0))
        return pair, pair + 1
    cells = layout.shape[0] * layout.shape[1]
    if cells > _MAX_TABLE_CELLS * flat.size:
        other = np.minimum(np.searchsorted(flat, flat + step), max(flat.size - 1, 0))
        pair = np.flatnonzero(flat[other] == flat + step)
        return pair, other[pair]
    place = np.full(cells + step, -1, dtype=np.int64)
    place[flat] = np.arange(flat.size)
    other = place[flat + step]
    pair = np.flatnonzero(other >= 0)
    return pair, other[pair]


def adjacent_scatter(z: Float, here: Index, slope: Float, partition: Partition) -> Float:
    """Scatter from cell to cell of ``z`` (n,) at the cells ``here`` (n,), by ``slope`` of all cells; (n,).

    It is the 90 % quantile of adjacent cells' differences, over the normal's. Cells of one part are not compared.
    """
    at = slope.ravel().take(here)
    flat, columns = partition.layout.flat(here), partition.shape[1]
    found, where = [], []
    for step in (columns, 1):
        pair, other = _neighbours(flat, step, partition.layout)
        apart = partition.apart(here, pair, other)
        pair, other = pair[apart], other[apart]
        found.append(np.abs(z[other] - z[pair]) / np.sqrt(2.0))
        where.append(at[pair])
    size, of_pair = np.concatenate(found), np.concatenate(where)
    if size.size < _MIN_DIFFERENCES:
        return np.ones(here.size)
    whole = max(sample_quantile(size, 0.9) / 1.6449, 1e-6)
    centres, scatter = [], []
    classes = class_of_slope(of_pair, _SLOPE_CLASS_DEG)
    for low, cells in enumerate(np.bincount(classes[classes >= 0])):
        if cells >= _MIN_DIFFERENCES:
            centres.append((low + 0.5) * _SLOPE_CLASS_DEG)
            scatter.append(max(sample_quantile(size[classes == low], 0.9) / 1.6449, 0.1 * whole))
    if not centres:
        return np.full(here.size, whole)
    return np.where(np.isnan(at), whole, np.interp(at, centres, scatter))
