"""Screening by the matched filter: zones of the slope's raster whose even t score passes the level of a budget."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from ...engine.core.arrays import Float, Float32
from ..preparation.even_scores import even_scores
from ..preparation.raster_zones import zones_above
from ..preparation.relief_raster import ReliefRaster

FILTER_DENSITY = (0.5, 450.0)
"""Ground points/m²: the same nine simulated slopes of 400, thinned down to 0.5, kept their false zones."""
_STEEPNESS = 4.0
"""How quickly the membership changes about the level: 0.02 where nothing stands out, 0.98 at twice the level."""
_BELOW, _ABOVE = 0.49, 0.51
"""Largest membership of a cell that is in no zone, and smallest of one that is: zones must be large enough."""


def filter_memberships(raster: ReliefRaster, level: float, flat: Float) -> Float32:
    """(m, 3) memberships of background, uplift and subsidence, the largest of which is the class, of places (m, 2 or 3)
    in the flat frame.

    A hazard's membership is 0.5 where the score is at the level, and above that in zones of at least 1 m² only. It says
    how far the score passes the level, and is no probability: that would depend on how many hazards the slope has.
    Where nothing is known, all is background.
    """
    scores = even_scores(raster)
    sides = [
        expit(_STEEPNESS * (np.nan_to_num(s, nan=-np.inf) / level - 1.0)) for s in (scores.uplift, scores.subsidence)
    ]
    inside = [zones_above(score, level, scores.cell)[0] > 0 for score in (scores.uplift, scores.subsidence)]
    both = np.maximum(sides[0] + sides[1], 1e-9)
    fade = np.where(inside[0] | inside[1], 1.0, np.minimum(1.0, _BELOW / both))
    up, down = (
        np.where(mine, np.maximum(share, _ABOVE), np.where(other, np.minimum(share, _BELOW), share * fade))
        for share, mine, other in zip(sides, inside, inside[::-1])
    )
    result = np.stack([np.maximum(1.0 - up - down, 0.0), up, down])
    result /= result.sum(axis=0)
    i, j = raster.index(flat)
    return result[:, i, j].T.astype(np.float32)
