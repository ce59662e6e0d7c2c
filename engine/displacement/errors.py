"""Errors of the windows' motions: a sandwich over blocks, made steadier by what all windows have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.arrays import Float
from .least_squares import PARAMETERS, Fit

COMMON_BLOCKS = 30.0
"""Blocks of a window that count as much as what all windows have in common."""
_MIN_BEND = 0.2  # of the weights' derivative by their mean; below, hardly a residual is near enough to be used
_REACH = 3.0  # medians of the residuals' scale up to which a window takes part in the common ratio


def covariances(fits: Sequence[Fit], blocks: Sequence[float], common: Float) -> Float:
    """(n, 3, 3) covariance of the motions, square metres.

    The sum over some twenty blocks is uncertain itself. It is therefore averaged with the one that residuals
    independent from node to node would have, times what the map's windows have in ``common``.

    Args:
        blocks: seen blocks of each fit.
        common: (5, 5) of ``common_ratio``.
    """
    if not fits:
        return np.zeros((0, 3, 3))
    meat, bread = (np.stack([getattr(fit, name) for fit in fits]) for name in ("meat", "bread"))
    bend = np.maximum([fit.bend for fit in fits], _MIN_BEND)
    root = _roots(fits)
    own = np.asarray(blocks, dtype=np.float64)
    share = (own / (own + COMMON_BLOCKS))[:, None, None]
    steady = share * meat + (1 - share) * (root @ common @ np.swapaxes(root, 1, 2))
    inverse = np.linalg.inv(bread) / bend[:, None, None]
    full = inverse @ steady @ np.swapaxes(inverse, 1, 2)
    return np.asarray(full[:, :3, :3])


def common_ratio(fits: Sequence[Fit]) -> Float:
    """(5, 5) mean over the windows of what the blocks say, in units of what independent residuals would give."""
    if not fits:
        return np.eye(PARAMETERS)
    back = np.linalg.inv(_roots(fits))
    ratio = back @ np.stack([fit.meat for fit in fits]) @ np.swapaxes(back, 1, 2)
    scale = np.array([fit.scale for fit in fits])
    return np.asarray(ratio[scale <= _REACH * np.median(scale)].mean(axis=0))


def _roots(fits: Sequence[Fit]) -> Float:
    white = np.stack([fit.white for fit in fits])
    trace = np.trace(white, axis1=1, axis2=2)[:, None, None]
    return np.linalg.cholesky(white + 1e-12 * trace * np.eye(PARAMETERS))
