"""Surveys a few days apart count as one: a velocity between them is mostly their error."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from itertools import pairwise

import numpy as np

from ..change.result import Change
from ..core.arrays import Float

MIN_VELOCITY_DAYS = 7
"""Between two surveys. Errors of 1 cm look like 10 mm a day after one day, and like 1.4 mm a day after a week."""


def visits(days: Float, change: Float, variance: Float) -> tuple[Float, Float, Float]:
    """Days, change and variance (n,) with the surveys within ``MIN_VELOCITY_DAYS`` of an earlier one averaged.

    The weighted mean stands at the last survey of each visit, and the others are NaN there. Its variance is widened by
    chi-square over the degrees of freedom if the surveys of a visit scatter more than their errors explain.

    Args:
        days, change, variance: as for ``velocity.zone_velocity``.
    """
    days, change, variance = days.copy(), change.copy(), variance.copy()
    known = np.flatnonzero(np.isfinite(change) & np.isfinite(variance) & (variance > 0))
    while len(known):
        visit = known[days[known] < days[known[0]] + MIN_VELOCITY_DAYS]
        known = known[len(visit) :]
        if len(visit) == 1:
            continue
        weight = 1.0 / variance[visit]
        mean = float(np.average(change[visit], weights=weight))
        misfit = float(np.sum(weight * (change[visit] - mean) ** 2)) / (len(visit) - 1)
        day = float(np.average(days[visit], weights=weight))
        change[visit[:-1]], variance[visit[:-1]] = np.nan, np.nan
        last = visit[-1]
        days[last], change[last], variance[last] = day, mean, max(1.0, misfit) / float(weight.sum())
    return days, change, variance


def detectable_rates(steps: Sequence[Change], dates: Sequence[date]) -> tuple[list[int], list[float]]:
    """Days between surveys, and the rate (mm a day) at which half of the cells are beyond their level between them.

    Intervals of less than ``MIN_VELOCITY_DAYS`` are left out if others are there.

    Args:
        steps: change of each survey from the second on since the one before.
        dates: of all surveys.
    """
    days = [(b - a).days for a, b in pairwise(dates)]
    counted = [n for n, step in enumerate(days) if step >= MIN_VELOCITY_DAYS] or list(range(len(days)))
    return [days[n] for n in counted], [1000 * steps[n].median_level / days[n] for n in counted]
