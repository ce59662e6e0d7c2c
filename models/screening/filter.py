"""Screening by the matched filter: zones of the slope's raster whose even t score passes the level of a budget."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from ...engine.core.arrays import Float32
from ..preparation.raster_zones import Scores

FILTER_DENSITY = (0.5, 450.0)
"""Ground points/m²: the same nine simulated slopes of 400, thinned down to 0.5, kept their false zones."""
_STEEPNESS = 4.0
"""How quickly the membership changes about the level: 0.02 where nothing stands out, 0.98 at twice the level."""


def filter_memberships(scores: Scores, level: float) -> Float32:
    """(3, columns, rows) memberships of background, uplift and subsidence.

    A hazard's membership says how far the score passes the level, at which it is 0.5. It is no probability: that would
    depend on how many hazards the slope has. Where nothing is known, all is background.
    """
    up, down = (
        expit(_STEEPNESS * (np.nan_to_num(score, nan=-np.inf) / level - 1.0))
        for score in (scores.uplift, scores.subsidence)
    )
    result = np.stack([np.maximum(1.0 - up - down, 0.0), up, down])
    return np.asarray(result / result.sum(axis=0), dtype=np.float32)
