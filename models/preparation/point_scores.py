"""Probabilities of the network on points as scores of the slope's cells, and their level for a number of false zones.

Zones are decided as those of the network on relief: log odds relative to most of the slope, above a level.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.special import logit

from ...engine.core.arrays import Bool, Float, Index
from .raster_zones import Scores, level_between
from .relative_scores import relative_scores

CENTRED, SPREAD_POWER = 0.75, 0.0
"""How the log odds are taken relative to the slope. The network reads heights in units of the slope's own roughness, so
that the spread of its odds says little more: at as many false zones, dividing by it found 29 instead of 33 % of the
hazards of 0.5 m on real ground. A part of the median alone holds from real ground to simulated slopes."""
OUTLINE = 3.2
"""Zones reach as far as the score is above it, about the level of three accepted false zones: the edge of a hazard has
lower odds than its middle, and at the level of one half of most hazards was left out."""
LEVELS = {0.1: 12.65, 0.2: 10.31, 0.3: 8.94, 0.5: 6.99, 1.0: 5.28, 2.0: 3.62, 3.0: 3.14, 5.0: 2.43, 10.0: 1.39}
"""Level for accepted false zones per 1,000 m², by conformal risk control as ``even_scores.LEVELS``, on 34 places, 25 of
9 real surveys and 9 simulated slopes; below 0.2 it is continued. ``benchmarks.screening_sites`` measures it."""
_LEAST = 1e-7
"""Probabilities are taken for no nearer to 0 or 1."""


def cell_means(
    values: NDArray[np.floating], index: tuple[Index, Index], number: NDArray[np.number], covered: Bool
) -> Float:
    """Means (k, columns, rows) of values (n, k) of points over those in each cell; empty cells take the nearest one's
    within the ``covered`` ground (columns, rows), NaN beyond.

    Args:
        index: columns and rows (n,) of the points. number: (n,) how many points each stands for.
    """
    place = np.ravel_multi_index(index, covered.shape)
    count = np.bincount(place, number, covered.size)
    total = np.stack([np.bincount(place, number * column, covered.size) for column in values.T])
    mean = (total / np.maximum(count, 1.0)).reshape(-1, *covered.shape)
    empty = (count == 0).reshape(covered.shape)
    near = distance_transform_edt(empty, return_distances=False, return_indices=True)
    return np.where(covered, mean[:, near[0], near[1]], np.nan)


def point_odds(probabilities: NDArray[np.floating]) -> Float:
    """Log odds (2, columns, rows) of uplift and of subsidence against all else, of probabilities (3, columns, rows)."""
    return np.asarray(logit(np.clip(probabilities[1:], _LEAST, 1.0 - _LEAST)), dtype=np.float64)


def point_scores(probabilities: NDArray[np.floating], cell: float) -> Scores:
    """Scores of cells by their probabilities (3, columns, rows) of background, uplift and subsidence, NaN without data:
    the log odds of either hazard against all else, relative to most of the slope.

    Args:
        cell: side of the cells, m.
    """
    up, down = point_odds(probabilities)
    return odds_scores(up, down, cell)


def odds_scores(uplift: NDArray[np.floating], subsidence: NDArray[np.floating], cell: float) -> Scores:
    """The same of log odds (columns, rows)."""
    relative = relative_scores(uplift, subsidence, cell, centred=CENTRED, power=SPREAD_POWER)
    return replace(relative, outline=OUTLINE)


def level_for(false_zones: float) -> float:
    """The level of these scores for accepted false zones per 1,000 m² (0.1 to 10)."""
    return level_between(LEVELS, false_zones)
