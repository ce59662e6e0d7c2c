"""Places that one of two surveys has missed: no point there, where the other's say that it should have some."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

MISSED = 7.0
"""Points expected in a window, from which having none is no chance (one window in a thousand)."""
_WIDER = 8
"""Times the reach of a window, over which the number of both surveys' points is compared."""


def missed_places(
    first: NDArray[np.number], second: NDArray[np.number], most: int, within: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Cells (rows, columns) in the middle of a place that one survey has missed.

    Where ground points are few, those of one survey may by chance all lie elsewhere, and the points beside tell of the
    place. Where by the other survey, and by how many points both have around, seven are expected in a window, their
    lack is no chance: the ground was hidden, or what lies there was not taken for ground, as a mound may be that has
    come since. The points beside it say nothing of such a place.

    Args:
        first, second: points of either survey in each cell.
        most: largest reach of a window around a cell, in cells; reaches are 1, 2, 4 ... up to it.
        within: cells that may be compared; no window is judged around others.
    """
    counts = [np.asarray(count, dtype=np.float64) for count in (first, second)]
    missed = np.zeros(within.shape, dtype=bool)
    reach = 1
    while reach <= most:
        near, around = ([_sums(count, size) for count in counts] for size in (reach, _WIDER * reach))
        for own, other in ((0, 1), (1, 0)):
            missed |= (near[own] == 0) & (near[other] * around[own] >= MISSED * around[other]) & (near[other] > 0)
        reach *= 2
    return missed & within


def _sums(count: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Over the square window of each cell; rounded, because a running sum depends on where it began."""
    size = 2 * reach + 1
    total: NDArray[np.float64] = np.rint(ndimage.uniform_filter(count, size, mode="constant") * size**2)
    return total
