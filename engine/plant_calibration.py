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
NARROWEST = 0.4


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
    """Factor, at most 1, of the error by plants with which 1 - ``confidence`` of stable cells under plants are beyond.

    Each epoch's cloud states its error against the true ground, of which two surveys of one season have much in common:
    the same grass on the same ground lifts both alike. Where the season differs nothing cancels. Which it is shows on
    stable ground: as in ``slope_error.calibrate`` the factor is taken from the quantile that the level is about, here
    of the cells whose error is plants' more than points'. It does not widen: that all grass lies lower after mowing is
    told by the plants' heights (``season``), and ground that moved by little would hide itself.

    What neighbours share tells only once, so squares of 2 m that hold such cells count as the number of samples: with
    fewer than 20 nothing is told (1), and the quantile is one standard error of its share higher.

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
    needed = ((dz[told] / quantile(confidence)) ** 2 - sampling[told] ** 2 - registration_error**2) / plants[told] ** 2
    surer = min(confidence + math.sqrt(confidence * (1.0 - confidence) / patches), 1.0)
    return float(np.clip(math.sqrt(max(sample_quantile(needed, surer), 0.0)), NARROWEST, 1.0))
