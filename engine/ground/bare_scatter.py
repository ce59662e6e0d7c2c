"""How much returns from bare ground scatter in a cloud, from the windows that look bare.

Noise is distributed normally (kurtosis 3, no skewness). Returns from plants are not: simulated grass shows 1.9, stubble
2.87 to 2.93, which is close, so that most of a cloud must look bare before a scatter larger than usual is believed.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ..core.arrays import Float
from ..geometry.columns import largest_sizes, least
from ..geometry.plane_cells import Planes
from ..statistics.nearest_known import nearest_known

TRIED_SCATTERS_M = (0.022, 0.035, 0.045, 0.06, 0.08, 0.1)
"""Scatters tried; the first at which enough of the windows are bare is taken."""
MIN_WINDOW_RETURNS = 50.0
MIN_KURTOSIS, MAX_SKEWNESS = 2.95, 0.2
MIN_BARE_SHARE, MIN_NOISY_BARE_SHARE = 0.5, 0.7
"""Of the windows that must look bare: for the usual scatter, and for a larger one. Of simulated bare ground four fifths
do, of stubble up to 0.55."""
MIN_RAISED_SCATTER_M = 0.0265
"""Steep stubble in 2 cm of noise scatters less, and is as normal; more than usual is believed from here on."""
REACH_SCATTERS = 4.5
"""Times the scatter tried within which returns take part."""
ROUNDS, MEDIAN_WINDOWS, GATHERED = 4, 5, 4
SAMPLE_SIDE_M = 40.0
"""Side of the square about the middle of the points that is looked at."""


def bare_scatter(points: Float, side: float) -> float | None:
    """Largest scatter (m) that bare ground shows, one of TRIED_SCATTERS_M; None where no window looks bare.

    Args:
        points: (n, 4) x, y, height, and height over a surface that follows the ground to some decimetres, m.
        side: of the windows, m.
    """
    middle = np.median(points[:, :2], axis=0)
    points = points[largest_sizes(points[:, :2] - middle) <= SAMPLE_SIDE_M / 2]
    if len(points) < MIN_WINDOW_RETURNS:
        return None
    planes = Planes((points[:, :2] - least(points[:, :2])) / side)
    for tried in TRIED_SCATTERS_M:
        enough = MIN_BARE_SHARE if tried == TRIED_SCATTERS_M[0] else MIN_NOISY_BARE_SHARE
        if _share_of_bare(points[:, 2], points[:, 3], planes, tried) >= enough:
            return tried
    return None


def _gathered(planes: Planes, total: Float) -> Float:
    """Sums over the windows some metres around: the kurtosis of a few hundred returns alone is too uncertain."""
    for _ in range(GATHERED):
        total = planes.pooled(total)
    return total


def _share_of_bare(height: Float, over: Float, planes: Planes, tried: float) -> float:
    """Share of the windows with enough returns whose returns are distributed like noise of at most ``tried`` m."""
    residual, weight = over, (np.abs(over) < 3.0 * REACH_SCATTERS * tried).astype(np.float64)
    for _ in range(ROUNDS):
        residual = height - planes.at_points(*planes.fit(height, weight, 0.0, 0.02))
        weight = (np.abs(residual) < 3.0 * REACH_SCATTERS * tried) / (1.0 + (residual / tried) ** 2)
    near = np.abs(residual) < REACH_SCATTERS * tried
    number, *sums = (_gathered(planes, total) for total in planes.power_sums(residual, near))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean, square, cube, fourth = (total / number for total in sums)
        variance = square - mean**2
        skewness = (cube - 3 * mean * square + 2 * mean**3) / variance**1.5
        kurtosis = (fourth - 4 * mean * cube + 6 * mean**2 * square - 3 * mean**4) / variance**2
    known = (number >= MIN_WINDOW_RETURNS) & np.isfinite(kurtosis)
    if not known.any():
        return 0.0
    nearest = nearest_known(known)

    def smooth(values: Float) -> Float:
        return ndimage.median_filter(values[nearest], size=MEDIAN_WINDOWS, mode="nearest")

    normal = (smooth(kurtosis) >= MIN_KURTOSIS) & (np.abs(smooth(skewness)) <= MAX_SKEWNESS)
    least = MIN_RAISED_SCATTER_M if tried > TRIED_SCATTERS_M[0] else 0.0
    bare = known & normal & (variance <= tried**2) & (variance >= least**2)
    return float(np.count_nonzero(bare) / np.count_nonzero(known))
