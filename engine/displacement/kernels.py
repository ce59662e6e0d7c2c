"""What least squares do for each node, in a loop that numba compiles, and by numpy with the same result."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Bool, Float, Index
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


Offset = tuple[int, int, float, float]
"""Rows and columns by which nodes are moved, and the shares (0 to 1) of a node behind them."""


def _both_by_numpy(
    first: Float, later: Float, rows: Index, columns: Index, places: Float, of_first: Offset, of_later: Offset
) -> tuple[Bool, Float, Float, Float]:
    values = [
        _sampled_by_numpy(surface, rows + i, columns + j, u, v)
        for surface, (i, j, u, v) in ((first, of_first), (later, of_later))
    ]
    seen = np.isfinite(values[0][0]) & np.isfinite(values[1][0])
    before, after = (np.ascontiguousarray(part[:, seen].T) for part in values)
    return seen, before, after, places[seen]


def _node_known(values: Float, i: int, j: int) -> bool:
    """Whether the four nodes from row ``i`` and column ``j`` on lie on the grid."""
    return i >= 0 and i < values.shape[1] - 1 and j >= 0 and j < values.shape[2] - 1


def _between_nodes(values: Float, k: int, i: int, j: int, u: float, v: float) -> float:
    """As ``sampled``, of layer ``k``."""
    value = (1.0 - u) * (1.0 - v) * values[k, i, j]
    value += (1.0 - u) * v * values[k, i, j + 1]
    value += u * (1.0 - v) * values[k, i + 1, j]
    value += u * v * values[k, i + 1, j + 1]
    return float(value)


@compiled(_both_by_numpy, _node_known, _between_nodes)
def sampled_in_both(
    first: Float, later: Float, rows: Index, columns: Index, places: Float, of_first: Offset, of_later: Offset
) -> tuple[Bool, Float, Float, Float]:
    """Which nodes (n,) both surfaces (3, height, width) know, and of those the values (m, 3) of both, and their places.

    Args:
        places: (n, 3) of the nodes.
        of_first, of_later: where the nodes lie on either surface, bilinear between its own.
    """
    count, m = len(rows), 0
    i_0, j_0, u_0, v_0 = of_first
    i_1, j_1, u_1, v_1 = of_later
    seen = np.zeros(count, dtype=np.bool_)
    before, after, place = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    for n in range(count):
        a, b, c, d = rows[n] + i_0, columns[n] + j_0, rows[n] + i_1, columns[n] + j_1
        if not (_node_known(first, a, b) and _node_known(later, c, d)):
            continue
        before[m, 0] = _between_nodes(first, 0, a, b, u_0, v_0)
        after[m, 0] = _between_nodes(later, 0, c, d, u_1, v_1)
        if not (np.isfinite(before[m, 0]) and np.isfinite(after[m, 0])):
            continue
        seen[n] = True
        for k in (1, 2):
            before[m, k] = _between_nodes(first, k, a, b, u_0, v_0)
            after[m, k] = _between_nodes(later, k, c, d, u_1, v_1)
        for k in range(3):
            place[m, k] = places[n, k]
        m += 1
    if m == count:
        return seen, before, after, place
    return seen, before[:m].copy(), after[:m].copy(), place[:m].copy()


def _tukey_by_numpy(residual: Float, limit: float) -> Float:
    share = residual / limit
    return np.asarray(np.where(np.abs(share) < 1, (1 - share**2) ** 2, 0.0))


@compiled(_tukey_by_numpy)
def tukey(residual: Float, limit: float) -> Float:
    """(n,) Tukey's weights of residuals (n,), 0 from ``limit`` on."""
    weight = np.zeros(len(residual))
    for n in range(len(residual)):
        share = residual[n] / limit
        if abs(share) < 1:
            rest = 1 - share * share
            weight[n] = rest * rest
    return weight


def _weighted_by_numpy(before: Float, after: Float, place: Float, weight: Float) -> tuple[Float, Float, Float]:
    jacobian = np.column_stack([(before[:, 1:] + after[:, 1:]) / 2, place])
    return jacobian, weight[:, None] * jacobian, np.ascontiguousarray(weight[:, None] * after[:, 1:])


@compiled(_weighted_by_numpy)
def weighted(before: Float, after: Float, place: Float, weight: Float) -> tuple[Float, Float, Float]:
    """(n, 5) derivatives of the residuals by all unknowns, (n, 5) these weighted, (n, 2) the later rises weighted.

    Args:
        before, after: (n, 3) of ``sampled_in_both``, ``place`` (n, 3) too.
        weight: (n,) of the nodes.
    """
    count = len(weight)
    jacobian, by_weight, later = np.empty((count, 5)), np.empty((count, 5)), np.empty((count, 2))
    for n in range(count):
        w = weight[n]
        for k in range(2):
            jacobian[n, k] = (before[n, k + 1] + after[n, k + 1]) / 2
            later[n, k] = w * after[n, k + 1]
        for k in range(3):
            jacobian[n, k + 2] = place[n, k]
        for k in range(5):
            by_weight[n, k] = w * jacobian[n, k]
    return jacobian, by_weight, later


def _block_sums_by_numpy(
    before: Float, after: Float, jacobian: Float, weight: Float, residual: Float, block: Index, blocks: int
) -> tuple[Float, Float]:
    terms, first, later = jacobian * (weight * residual)[:, None], before[:, 1:], after[:, 1:]
    sums = np.stack([np.bincount(block, terms[:, k], blocks) for k in range(5)], axis=1)
    parts = np.empty((blocks, 5, 5))
    for i in range(5):
        for j in range(i + 1):
            product = jacobian[:, i] * jacobian[:, j]
            if i < 2:
                product = (first[:, i] * later[:, j] + first[:, j] * later[:, i]) / 2
            parts[:, i, j] = parts[:, j, i] = np.bincount(block, weight * product, blocks)
    return sums.astype(np.float64, copy=False), parts


@compiled(_block_sums_by_numpy)
def block_sums(
    before: Float, after: Float, jacobian: Float, weight: Float, residual: Float, block: Index, blocks: int
) -> tuple[Float, Float]:
    """Sums over the nodes of each block: (blocks, 5) of gradients, and (blocks, 5, 5) of the normal matrix.

    Of the matrix the gradients' part is of one survey times the other. ``block`` (n,) is the nodes' block; one beyond
    is an IndexError.
    """
    sums, parts = np.zeros((blocks, 5)), np.zeros((blocks, 5, 5))
    for n in range(len(block)):
        b = block[n]
        if b < 0 or b >= blocks:
            raise IndexError
        w = weight[n]
        error = w * residual[n]
        for i in range(5):
            sums[b, i] += jacobian[n, i] * error
            for j in range(i + 1):
                if i < 2:
                    f_i, f_j, l_i, l_j = before[n, i + 1], before[n, j + 1], after[n, i + 1], after[n, j + 1]
                    parts[b, i, j] += w * ((f_i * l_j + f_j * l_i) / 2)
                else:
                    parts[b, i, j] += w * (jacobian[n, i] * jacobian[n, j])
    for b in range(blocks):
        for i in range(5):
            for j in range(i):
                parts[b, j, i] = parts[b, i, j]
    return sums, parts
