"""Covariance of a least-squares solution from how blocks of a surface disagree.

Patches that stand near to one another err together: they moved together, or lie on one bend of a survey. Errors are
therefore taken from leaving out one block after the other (Efron and Stein 1981, doi:10.1214/aos/1176345462).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.special import ndtri, stdtrit

from ..core.arrays import Float

_RIDGE = 1e-3  # of a direction that one block alone fixes
_COVERAGE = 0.95  # of two standard errors, for any number of blocks


def block_jackknife(matrices: Float, vectors: Float, solution: Float, block: NDArray[np.int64]) -> tuple[Float, Float]:
    """Covariance (p, p) of the ``solution`` (p,) of the summed equations, and the matrix (p, p) by which few blocks
    widen it: the covariance with it is ``widen @ covariance @ widen``.

    A direction that few blocks fix has an error of few degrees of freedom: two standard errors then cover less than
    95 % of the cases. The widened errors cover them by Student's distribution. The degrees of freedom follow from how
    evenly the blocks share the information on the direction (Satterthwaite 1946, doi:10.2307/3002019).

    Args:
        matrices, vectors: (k, p, p) and (k, p) of the patches; the solution makes the sum of M s + v vanish.
        block: (k,) number of each patch's block.
    """
    size = len(solution)
    sums = csr_array((np.ones(len(block)), (block, np.arange(len(block)))))
    parts = (sums @ matrices.reshape(len(block), -1)).reshape(-1, size, size)
    whole = parts.sum(axis=0)
    without = whole - parts + _RIDGE * np.diag(np.diag(whole))
    left = sums @ (vectors + matrices @ solution)
    steps = np.linalg.solve(without, left[:, :, None])[:, :, 0]
    covariance = steps.T @ steps
    _, axes = np.linalg.eigh(covariance)
    gain = np.linalg.solve(whole, axes)
    share = np.maximum(np.einsum("ia,bij,ja->ba", gain, parts, gain), 0.0)
    freedom = np.maximum(share.sum(axis=0) ** 2 / np.maximum((share**2).sum(axis=0), 1e-300) - 1.0, 1.0)
    tail = (1 + _COVERAGE) / 2
    factor = stdtrit(freedom, tail) / ndtri(tail)
    return np.asarray(covariance), np.asarray((axes * factor) @ axes.T)
