"""Persistence: how many comparisons in a row confirm a change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float


def longest_run(confirmed: Sequence[bool], measured: Sequence[bool]) -> int:
    """Largest number of comparisons in a row that confirm; one without a measurement neither counts nor breaks."""
    best = run = 0
    for yes, known in zip(confirmed, measured, strict=True):
        if known:
            run = run + 1 if yes else 0
            best = max(best, run)
    return best


def confirmed_cells(change: Sequence[Float], level: Sequence[Float]) -> NDArray[np.int64]:
    """``longest_run`` in each cell (rows, columns): comparisons beyond the level with one sign.

    Args:
        change, level: of the differences to the first survey, metres; NaN where not measured.
    """
    shape = change[0].shape
    best, run = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    sign = np.zeros(shape)
    for dz, limit in zip(change, level, strict=True):
        known = np.isfinite(dz)
        with np.errstate(invalid="ignore"):
            now = np.where(np.abs(dz) > limit, np.sign(dz), 0.0)
        run = np.where(known, np.where(now == 0, 0, np.where(now == sign, run, 0) + 1), run)
        sign = np.where(known, now, sign)
        best = np.maximum(best, run)
    return best
