"""A network's log odds as scores that mean about the same on every slope.

How surely a network takes ground for a hazard depends on how rough the ground is: at one level of its log odds a slope
of gullies had 7 false zones per 1,000 m² where others had none. What most of a slope's own ground gives tells how much:
log odds over their median, divided by how far the upper cells lie above it, hold from survey to survey.
"""

from __future__ import annotations

import numpy as np

from ...engine.core.arrays import Float32
from .raster_zones import Scores

MIDDLE, UPPER = 0.5, 0.85
"""Quantiles of the log odds of both signs together that stand for the slope's ground: hazards hardly reach the upper
one, as long as they cover less than a seventh of the slope."""
SPREAD_POWER = 0.7
"""By how much of the spread, as a power, scores are divided: 0 leaves rough slopes with more false zones than smooth
ones, 1 takes more hazards from the smooth ones than it spares."""
_MIN_SPREAD = 0.2


def relative_scores(uplift: Float32, subsidence: Float32, cell: float) -> Scores:
    """Log odds (columns, rows) of uplift and of subsidence over those of most of the slope; NaN without data stays.

    Args:
        cell: side of the cells, m.
    """
    known = np.concatenate([odds[np.isfinite(odds)] for odds in (uplift, subsidence)])
    if not len(known):
        return Scores(uplift, subsidence, cell)
    middle, upper = np.quantile(known, (MIDDLE, UPPER))
    spread = max(float(upper - middle), _MIN_SPREAD) ** SPREAD_POWER
    return Scores((uplift - middle) / spread, (subsidence - middle) / spread, cell)
