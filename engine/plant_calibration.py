"""How far the errors that clouds state for their plants hold between two surveys, as stable ground tells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .gridding import Float
from .order_statistics import sample_quantile
from .thresholds import quantile

PATCH_M = 2.0
"""Side of the squares of which each tells once, m: plants err alike over about so much."""
FEWEST_PATCHES = 20
NARROWEST, WIDEST = 0.4, 2.0


def plants_factor(
    dz: Float,
    sampling: Float,
    plants: Float,
    stable: NDArray[np.bool_],
    cell: float,
    *,
    registration_error: float,
    confidence: float,
) -> float:
    """Factor of the error by plants with which 1 - ``confidence`` of the stable cells under plants are beyond.

    Each epoch's cloud states its error against the true ground, of which two surveys of one season have much in common:
    the same grass on the same ground lifts both alike. Where the season differs nothing cancels. Which it is shows on
    stable ground: as in ``slope_error.calibrate`` the factor is taken from the quantile that the level is about, here
    of the cells whose error is plants' more than points'.

    What neighbours share tells only once, so squares of 2 m that hold such cells count as the number of samples: with
    fewer than 20 nothing is told (1), and a factor below 1 is taken from a quantile one standard error higher.

    Args:
        dz, sampling, plants: change, its standard error by points (calibrated) and that by plants, metres (rows,
            columns); NaN where not compared.
        stable: one cell of each grown cell that is taken as stable.
        cell: side of a cell, metres.
        registration_error: metres.
    """
    with np.errstate(invalid="ignore"):
        told = stable & np.isfinite(dz) & (plants > sampling)
    row, column = np.nonzero(told)
    width = max(round(PATCH_M / cell), 1)
    patches = len(np.unique(np.column_stack([row // width, column // width]), axis=0))
    if patches < FEWEST_PATCHES:
        return 1.0
    others = sampling[told] ** 2 + registration_error**2
    needed = ((dz[told] / quantile(confidence)) ** 2 - others) / plants[told] ** 2
    factor = math.sqrt(max(sample_quantile(needed, confidence), 0.0))
    if factor < 1.0:
        surer = min(confidence + math.sqrt(confidence * (1.0 - confidence) / patches), 1.0)
        factor = min(math.sqrt(max(sample_quantile(needed, surer), 0.0)), 1.0)
    return float(np.clip(factor, NARROWEST, WIDEST))
