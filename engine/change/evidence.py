"""How much evidence a single cell's change is, where a zone needs several cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from ..core.arrays import Float

_MEAN_BY_CHANCE = 1.0 - float(np.log(0.05))
"""Mean of -ln p over the cells that chance alone brings beyond their level of 95 %."""


def cells_worth(dz: NDArray[np.floating], sigma: NDArray[np.floating], least: float) -> Float:
    """For how many cells each one counts towards the ``least`` number of a zone; arrays of one shape.

    That number guards against cells that lie beyond their level by chance. A small change under plants may show in two
    grown cells only, far beyond their level, which is no chance either. Improbabilities of independent cells add as
    -ln p (Fisher's method), and what chance brings beyond its level has ln 20 + 1 of it on average: a cell counts for
    as many of these as it holds, 1 at least. Errors of ground under plants may have heavier tails than a normal
    distribution, so no cell counts for more than half of the ``least`` number: two are always needed.

    Args:
        dz, sigma: change and its standard error, metres; a cell without either counts for 1.
    """
    most = max(least / 2.0, 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        improbable = -float(np.log(2.0)) - log_ndtr(-np.abs(np.asarray(dz, dtype=np.float64)) / sigma)
    worth = np.nan_to_num(improbable / _MEAN_BY_CHANCE, nan=1.0, posinf=most)
    return np.asarray(np.clip(worth, 1.0, most), dtype=np.float64)
