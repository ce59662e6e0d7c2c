"""Persistence: how many comparisons in a row confirm a change, and whether its motion has come to rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ..core.arrays import Float
from ..statistics.normal import Z95
from .velocity import fit_line

_MIN_FIT_PROBABILITY = 0.001  # surveys that scatter more than chance does in so few cases are not at rest


def current_run(confirmed: Sequence[bool], measured: Sequence[bool]) -> int:
    """Number of the last comparisons in a row that confirm; one without a measurement neither counts nor breaks."""
    run = 0
    for yes, known in zip(confirmed, measured, strict=True):
        if known:
            run = run + 1 if yes else 0
    return run


def rest_since(days: Float, change: Float, variance: Float, quiet: int, beyond: float = Z95) -> int | None:
    """Index of the first survey since which what moved before is at rest; None where it is not.

    ``quiet`` intervals or more up to the last survey show no motion: one place explains their scatter, their velocity
    is not significant, and with its 95 % interval it is below half of the velocity that the motion had beyond chance
    between any two surveys. A creep that is too slow to show between two surveys is not at rest.

    Args:
        days, change, variance: as for ``velocity.zone_velocity``, (n,) each.
        beyond: standard errors beyond which a velocity is significant.
    """
    known = np.flatnonzero(np.isfinite(change) & np.isfinite(variance) & (variance > 0))
    t, x, v = days[known], change[known], variance[known]
    first, last = np.triu_indices(len(t), 1)
    if len(t) < quiet + 2:
        return None
    dt = t[last] - t[first]
    fastest = float(np.max((np.abs(x[last] - x[first]) - Z95 * np.sqrt(v[last] + v[first])) / dt))
    for start in range(1, len(t) - quiet):
        line = fit_line(t[start:], x[start:], v[start:])
        still = abs(line.slope) <= beyond * line.error and abs(line.slope) + Z95 * line.error < fastest / 2
        # ground that went and was filled up again is level on the whole, too
        if still and float(chdtrc(len(t) - start - 2, line.misfit)) >= _MIN_FIT_PROBABILITY:
            return int(known[start])
    return None


def confirmed_cells(change: Sequence[Float], level: Sequence[Float]) -> NDArray[np.int64]:
    """Longest run in each cell (rows, columns) of comparisons beyond the level with one sign.

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
