"""Windows of bare ground: their returns scatter as little as bare ground does, and are distributed like noise."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float
from ..geometry.plane_cells import Planes
from ..statistics.nearest_known import nearest_known

MIN_KURTOSIS, MIN_NARROWER_M = 2.75, 0.01
"""Returns from bare ground are distributed about normally (3), from a layer more evenly (1.8): bare ground must be
narrower by so many metres for each unit less."""
MEDIAN_WINDOWS, NEIGHBOURS_HELP_M = 5, 0.006
"""Windows on a side whose median decides, and by how much one among bare ones may scatter more."""
MIN_BARE_RETURNS = 20.0
"""Returns from which bare ground is recognised."""
JUDGED_M, JUDGED_SCATTERS = 0.1, 4.5
"""Height over and below the ground of the returns by which a window is judged: at least m, and times the scatter."""


def narrow_windows(height: Float, planes: Planes, scatter: float, median: bool = True) -> tuple[Bool, Float]:
    """Windows whose returns about 0 scatter as those from bare ground do, and the returns' mean, m.

    Args:
        height: (n,) of returns over the ground of their window, m.
        scatter: largest that bare ground has, m.
        median: whether the windows around decide too.
    """
    near = np.abs(height) < max(JUDGED_M, JUDGED_SCATTERS * scatter)
    number, *sums = (planes.pooled(planes.pooled(total)) for total in planes.power_sums(height, near))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean, square, cube, fourth = (total / number for total in sums)
        variance = np.maximum(square - mean**2, 0.0)
        kurtosis = (fourth - 4 * mean * cube + 6 * mean**2 * square - 3 * mean**4) / variance**2
        spread = np.sqrt(variance)
        score = spread - MIN_NARROWER_M * (kurtosis - MIN_KURTOSIS)
    known = (number >= MIN_BARE_RETURNS) & np.isfinite(score)
    if not median:
        return known & (score <= scatter), mean
    return known & (score <= scatter + NEIGHBOURS_HELP_M) & (_median_around(score, known) <= scatter), mean


def _median_around(values: Float, known: Bool) -> Float:
    """Median of MEDIAN_WINDOWS x MEDIAN_WINDOWS windows; an unknown one counts as the nearest that is known."""
    if not known.any():
        return np.full(values.shape, np.inf)
    return np.asarray(
        ndimage.median_filter(values[nearest_known(known)], size=MEDIAN_WINDOWS, mode="nearest"), np.float64
    )
