"""How far the errors of grown cells hold, by size: large ones lie where points are few and some are plants."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..statistics.normal import quantile
from .measured import Measured

_MIN_CELLS = 60  # stable cells of a size; with 5 % beyond, their share is known to 3 %
_MAX_FACTOR = 3.0


def widening_by_size(
    measured: Measured, stable: NDArray[np.bool_], *, registration_error: float, confidence: float
) -> Float:
    """Factor (rows, columns), 1 or more, with which 1 - ``confidence`` of the stable cells of each size are beyond.

    As ``slope_calibration.calibrate`` does by slope, but it only widens: plants that the extraction left in the ground
    are not in the scatter of a few points that lie on them together. Sizes with fewer than 60 stable cells get the
    factor of the next smaller one.

    Args:
        measured: its error by plants is no part of what is widened.
        stable: (rows, columns) one cell of each grown cell that is taken as stable.
        registration_error: metres.
    """
    dz, sampling, plants, size = measured.dz, measured.sampling, measured.by_plants, measured.partition.sizes
    known = stable & np.isfinite(dz) & np.isfinite(sampling) & (sampling > 0)
    others = registration_error**2 + (0.0 if plants is None else plants[known] ** 2)
    needed = ((dz[known] / quantile(confidence)) ** 2 - others) / sampling[known] ** 2
    factor = np.ones(dz.shape)
    last = 1.0
    for side in np.unique(size[np.isfinite(size)]):
        of_size = needed[size[known] == side]
        if of_size.size >= _MIN_CELLS:
            square = float(np.quantile(of_size, confidence))
            last = float(np.clip(np.sqrt(max(square, 0.0)), 1.0, _MAX_FACTOR))
        factor[size == side] = last
    return factor
