"""What least squares do for each node, in a loop that numba compiles, and by numpy with the same result."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float, Index
from ..core.compiled import compiled


def _sampled_by_numpy(values: Float, rows: Index, columns: Index, u: float, v: float) -> Float:
    height, width = values.shape[1:]
    outside = (rows < 0) | (rows >= height - 1) | (columns < 0) | (columns >= width - 1)
    i, j = np.where(outside, 0, rows), np.where(outside, 0, columns)
    found = (1.0 - u) * (1.0 - v) * values[:, i, j]
    found += (1.0 - u) * v * values[:, i, j + 1]
    found += u * (1.0 - v) * values[:, i + 1, j]
    found += u * v * values[:, i + 1, j + 1]
    found[:, outside] = np.nan
    return np.asarray(found)


@compiled(_sampled_by_numpy)
def sampled(values: Float, rows: Index, columns: Index, u: float, v: float) -> Float:
    """(3, n) bilinear values (3, height, width) at nodes (n,), ``u`` and ``v`` (0 to 1) of a node behind them.

    NaN where one of the four nodes around is unknown or beyond the grid.
    """
    found = np.empty((3, len(rows)))
    height, width = values.shape[1], values.shape[2]
    for n in range(len(rows)):
        i, j = rows[n], columns[n]
        for k in range(3):
            if i < 0 or i >= height - 1 or j < 0 or j >= width - 1:
                found[k, n] = np.nan
                continue
            value = (1.0 - u) * (1.0 - v) * values[k, i, j]
            value += (1.0 - u) * v * values[k, i, j + 1]
            value += u * (1.0 - v) * values[k, i + 1, j]
            value += u * v * values[k, i + 1, j + 1]
            found[k, n] = value
    return found
