"""Log odds of the raster network relative to the slope's own, and the level of them for a number of false zones.

The network's log odds lie higher on one survey than on another. What stands out of a slope stands out of the bulk of
its own cells: log odds over the median of the slope's, in units of the distance from there to a higher quantile, mean
the same on all surveys that were tried, so that one level holds on all (``benchmarks.screening_sites`` measures it).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .raster_zones import Scores, level_between

LOW_QUANTILE, HIGH_QUANTILE = 0.5, 0.85
"""Of the log odds of uplift and of subsidence together, over the slope's cells: where the score is 0 and 1."""
_MIN_DISTANCE = 1e-3
LEVELS = {0.1: 7.2, 0.2: 6.2, 0.3: 5.32, 0.5: 4.88, 1.0: 4.24, 2.0: 3.67, 3.0: 3.34, 5.0: 2.85, 10.0: 2.17}
"""Level for accepted false zones per 1,000 m², by conformal risk control as ``even_scores.LEVELS``, on 21 places, real
and simulated, by networks that had not seen the real ones; below 0.2 it is continued."""


def relative_scores(up: NDArray[np.floating], down: NDArray[np.floating], cell: float) -> Scores:
    """Scores of log odds ``up`` of uplift and ``down`` of subsidence against the rest, (columns, rows), NaN without
    data; ``cell`` in m.
    """
    both = np.concatenate([up[np.isfinite(up)], down[np.isfinite(down)]])
    if not len(both):
        return Scores(up, down, cell)
    low, high = np.quantile(both, [LOW_QUANTILE, HIGH_QUANTILE])
    distance = max(float(high - low), _MIN_DISTANCE)
    return Scores((up - low) / distance, (down - low) / distance, cell)


def level_for(false_zones: float) -> float:
    """The level of relative scores for accepted false zones per 1,000 m² (0.1 to 10)."""
    return level_between(LEVELS, false_zones)
