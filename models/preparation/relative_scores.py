"""A network's log odds as scores that mean about the same on every slope, and their level for a number of false zones.

How surely a network takes ground for a hazard depends on how rough the ground is: at one level of its log odds a slope
of gullies had 7 false zones per 1,000 m² where others had none. What most of a slope's own ground gives tells how much:
log odds over their median, divided by how far the upper cells lie above it, hold from survey to survey.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .raster_zones import Scores, level_between

MIDDLE, UPPER = 0.5, 0.85
"""Quantiles of the log odds of both signs together that stand for the slope's ground: hazards hardly reach the upper
one, as long as they cover less than a seventh of the slope."""
SPREAD_POWER = 0.7
"""By how much of the spread, as a power, scores are divided: 0 leaves rough slopes with more false zones than smooth
ones, 1 takes more hazards from the smooth ones than it spares."""
_MIN_SPREAD = 0.2
LEVELS = {0.1: 7.8, 0.2: 6.67, 0.3: 5.33, 0.5: 4.8, 1.0: 4.14, 2.0: 3.6, 3.0: 3.28, 5.0: 2.73, 10.0: 2.1}
"""Level for accepted false zones per 1,000 m², by conformal risk control as ``even_scores.LEVELS``, on 21 places, 15 of
6 real surveys and 6 simulated slopes, by networks that had not seen the real ones; below 0.2 it is continued."""


def relative_scores(
    uplift: NDArray[np.floating],
    subsidence: NDArray[np.floating],
    cell: float,
    *,
    centred: float = 1.0,
    power: float = SPREAD_POWER,
) -> Scores:
    """Log odds (columns, rows) of uplift and of subsidence over those of most of the slope; NaN without data stays.

    Args:
        cell: side of the cells, m.
        centred: share of the slope's median that is taken off. power: of its spread by which they are divided.
    """
    known = np.concatenate([odds[np.isfinite(odds)] for odds in (uplift, subsidence)])
    if not len(known):
        return Scores(uplift, subsidence, cell)
    middle, upper = np.quantile(known, (MIDDLE, UPPER))
    spread = max(float(upper - middle), _MIN_SPREAD) ** power
    middle *= centred
    return Scores((uplift - middle) / spread, (subsidence - middle) / spread, cell)


def level_for(false_zones: float) -> float:
    """The level of relative scores for accepted false zones per 1,000 m² (0.1 to 10)."""
    return level_between(LEVELS, false_zones)
