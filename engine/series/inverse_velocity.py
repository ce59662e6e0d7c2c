"""Inverse velocity: when an accelerating motion would end in failure, as an interval or not at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, chdtri

from ..core.arrays import Float
from .acceleration import MIN_SURVEYS, Acceleration, acceleration

EXPONENTS = (1.5, 2.5)
"""Range of the exponent alpha of Voight's law, our choice; 2 is Fukuzono's straight line of 1/v."""
_EXPONENT_COUNT = 31
MAX_CHANCE = 0.001
"""That a steady motion looks accelerating: with more no failure time is given."""
_MAX_FAILURE_SPANS = 10.0  # of the failure, in durations of the fitted motion after the last survey
_MIN_FIT_PROBABILITY = 0.05  # a fit that chance would make worse in fewer cases than this is refused
_END_COUNT = 600


@dataclass(frozen=True)
class FailureTime:
    """95 % interval of the failure, in days since the first survey; both None where it is ``reason`` why not.

    ``chance`` that a steady motion is surveyed like this (see ``acceleration``).
    """

    earliest: float | None
    latest: float | None
    reason: str
    chance: float = 1.0


def failure_time(
    days: Float, change: Float, variance: Float, exponents: tuple[float, float] = EXPONENTS
) -> FailureTime:
    """Interval of the failure time by Voight's law, v' = A v^alpha, with alpha anywhere in ``exponents``.

    The law's integral is fitted to the displacements rather than 1/v to a line: the surveys' errors are independent,
    those of the velocities between them are not, and a mean velocity is not that of the interval's middle. It is
    fitted to as many of the last surveys as it fits best, because a motion is steady before it follows the law; to five
    at least: three unknowns and two degrees of freedom.
    The interval holds all times whose chi-square is at most that of the best one plus 3.84 (times the reduced
    chi-square where that is above one) with any of the exponents.

    Only where ``acceleration`` finds the motion faster beyond ``MAX_CHANCE``, and where the interval ends.

    Args:
        days: (n,) days of the surveys since the first.
        change: (n,) mean change of a zone against the first survey, metres; NaN where it was not measured.
        variance: (n,) each survey's own variance, m².

    Sources: Fukuzono 1985 (Proc. 4th Int. Conf. Field Workshop on Landslides, 145-150); Voight 1989
    (doi:10.1126/science.243.4888.200).
    """
    found = acceleration(days, change, variance)
    if found.reason:
        return _not(found.reason, found)
    if found.chance > MAX_CHANCE:
        return _not("a steady motion explains the surveys", found)
    known = np.isfinite(change) & np.isfinite(variance) & (variance > 0)
    t, x, v = days[known], change[known], variance[known]
    fits = []
    for start in range(len(t) - MIN_SURVEYS + 1):
        left, misfit = _misfits(t[start:], x[start:], v[start:], exponents)
        degrees = len(t) - start - 3
        fits.append((float(chdtrc(degrees, misfit.min())), degrees, left, misfit.min(axis=0)))
    probability, degrees, left, best = max(fits, key=lambda fit: fit[0])
    if probability < _MIN_FIT_PROBABILITY:
        return _not("no law of failure fits the surveys", found)
    return _interval(t, left, best, degrees, found)


def _misfits(t: Float, x: Float, v: Float, exponents: tuple[float, float]) -> tuple[Float, Float]:
    """Days left (m,), evenly in their logarithm, and chi-square (exponents, m) of failures after so many days."""
    span = float(t[-1] - t[0])
    left = span * np.geomspace(1e-3, _MAX_FAILURE_SPANS, _END_COUNT)
    count = 1 if exponents[0] == exponents[1] else _EXPONENT_COUNT
    return left, np.stack([_misfit(t, x, v, float(t[-1]) + left, a) for a in np.linspace(*exponents, count)])


def _interval(t: Float, left: Float, misfit: Float, degrees: int, found: Acceleration) -> FailureTime:
    best = float(misfit.min())
    inside = np.flatnonzero(misfit <= best + float(chdtri(1, 0.05)) * max(1.0, best / degrees))
    if inside[-1] == len(left) - 1:
        return _not("the failure may be any time ahead", found)
    # what lies between two steps counts as inside
    earliest = 0.0 if inside[0] == 0 else float(left[inside[0] - 1])
    last = float(t[-1])
    return FailureTime(last + earliest, last + float(left[inside[-1] + 1]), "", found.chance)


def _misfit(t: Float, x: Float, v: Float, ends: Float, exponent: float) -> Float:
    """Chi-square (m,) of the best place and size of the motion for a failure at each of ``ends`` (m,)."""
    left, power = ends[:, None] - t, 1.0 - 1.0 / (exponent - 1.0)
    u = -np.log(left) if abs(power) < 1e-9 else -(left**power) * np.sign(power)
    weight = 1.0 / v
    du = u - (u @ weight / weight.sum())[:, None]
    dx = x - np.average(x, weights=weight)
    slope = (du * dx) @ weight / (du**2 @ weight)
    rest: Float = (dx - slope[:, None] * du) ** 2 @ weight
    return rest


def _not(reason: str, found: Acceleration) -> FailureTime:
    return FailureTime(None, None, f"not computable: {reason}", found.chance)
