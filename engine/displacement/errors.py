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


def covariances(fits: Sequence[Fit], blocks: int) -> Float:
    """(n, 3, 3) covariance of the motions, square metres.

    The sum over some twenty blocks is uncertain itself. It is therefore averaged with the one that residuals
    independent from node to node would have, times the ratio of the two over the map (5, 5).

    Args:
        blocks: of a whole window.
    """
    if not fits:
        return np.zeros((0, 3, 3))
    meat, white, bread = (np.stack([getattr(fit, name) for fit in fits]) for name in ("meat", "white", "bread"))
    bend = np.maximum([fit.bend for fit in fits], _MIN_BEND)
    own = blocks * np.array([fit.seen for fit in fits])
    root = np.linalg.cholesky(white + 1e-12 * np.trace(white, axis1=1, axis2=2)[:, None, None] * np.eye(PARAMETERS))
    back = np.linalg.inv(root)
    ratio = back @ meat @ np.swapaxes(back, 1, 2)
    common = root @ _common_ratio(ratio, np.array([fit.scale for fit in fits])) @ np.swapaxes(root, 1, 2)
    share = (own / (own + COMMON_BLOCKS))[:, None, None]
    steady = share * meat + (1 - share) * common
    inverse = np.linalg.inv(bread) / bend[:, None, None]
    full = inverse @ steady @ np.swapaxes(inverse, 1, 2)
    return np.asarray(full[:, :3, :3])


def _common_ratio(ratio: Float, scale: Float) -> Float:
    usual = scale <= _REACH * np.median(scale)
    return np.asarray(ratio[usual].mean(axis=0))
