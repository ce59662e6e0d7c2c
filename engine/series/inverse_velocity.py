"""Inverse velocity: when an accelerating motion would end in failure, as an interval or not at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, chdtri

from ..core.arrays import Float
from ..statistics.normal import Z95

_MIN_EPOCHS, _MIN_VELOCITIES = 4, 3
_MAX_FAILURE_SPANS = 10.0  # of the failure, in durations of the accelerating motion after the last survey
_MIN_FIT_PROBABILITY = 0.01  # a fit that chance would make worse in fewer cases than this is no straight line of 1/v
_END_COUNT = 4000


@dataclass(frozen=True)
class FailureTime:
    """95 % interval of the failure, in days since the first survey; both None where it is ``reason`` why not."""

    earliest: float | None
    latest: float | None
    reason: str


def failure_time(days: Float, change: Float, variance: Float) -> FailureTime:
    """Interval of the failure time by Fukuzono's law with alpha = 2, where 1/v falls linearly to zero.

    The law's integral, x = c - ln(t_f - t) / a, is fitted to the displacements rather than 1/v to a line: the surveys'
    errors are independent, those of the velocities between them are not, and a mean velocity is not that of the
    interval's middle. The interval holds all t_f whose chi-square is at most that of the best one plus 3.84 (times the
    reduced chi-square where that is above one).

    Only where the last surveys in a row, at least four, have velocities beyond their level of detection (1.96 times
    their error), of one sign, each larger than the one before; where the law fits; and where the interval ends, that
    is, where the motion can be distinguished from a steady one.

    Args:
        days: (n,) days of the surveys since the first.
        change: (n,) mean change of a zone against the first survey, metres; NaN where it was not measured.
        variance: (n,) each survey's own variance, m².

    Sources: Fukuzono 1985 (Proc. 4th Int. Conf. Field Workshop on Landslides, 145-150); Voight 1989
    (doi:10.1126/science.243.4888.200).
    """
    known = np.isfinite(change) & np.isfinite(variance) & (variance > 0)
    t, x, v = days[known], change[known], variance[known]
    if len(t) < _MIN_EPOCHS:
        return _not(f"{len(t)} surveys, at least {_MIN_EPOCHS} are needed")
    dt = np.diff(t)
    speed = np.diff(x) / dt
    beyond = np.abs(speed) > Z95 * np.sqrt(v[1:] + v[:-1]) / dt
    if not beyond[-1]:
        return _not("the last velocity is not above its level of detection")
    size = np.abs(speed)
    start = len(speed) - 1
    while start > 0 and beyond[start - 1] and speed[start - 1] * speed[-1] > 0 and size[start - 1] < size[start]:
        start -= 1
    run = len(speed) - start
    if run < _MIN_VELOCITIES:
        if len(speed) > run and size[-1] <= size[-2]:
            return _not("the motion does not get faster")
        return _not(
            f"{run} velocities in a row that grow and are above their level of detection, {_MIN_VELOCITIES} are needed"
        )
    return _interval(t[start:], x[start:], v[start:])


def _interval(t: Float, x: Float, v: Float) -> FailureTime:
    span = float(t[-1] - t[0])
    # evenly in the logarithm of the time left: 1/1000 of the span to _MAX_FAILURE_SPANS spans
    left = span * np.geomspace(1e-3, _MAX_FAILURE_SPANS, _END_COUNT)
    misfit = _misfit(t, x, v, float(t[-1]) + left)
    best = float(misfit.min())
    degrees = len(t) - 3
    if degrees > 0 and float(chdtrc(degrees, best)) < _MIN_FIT_PROBABILITY:
        return _not("the inverse velocity does not fall along a straight line")
    allowed = best + float(chdtri(1, 0.05)) * max(1.0, best / degrees if degrees > 0 else 1.0)
    inside = np.flatnonzero(misfit <= allowed)
    if inside[-1] == len(left) - 1:
        return _not("the motion cannot be distinguished from a steady one")
    # what lies between two steps counts as inside
    earliest = 0.0 if inside[0] == 0 else float(left[inside[0] - 1])
    return FailureTime(float(t[-1]) + earliest, float(t[-1]) + float(left[inside[-1] + 1]), "")


def _misfit(t: Float, x: Float, v: Float, ends: Float) -> Float:
    """Chi-square (m,) of the best c and a for a failure at each of ``ends`` (m,)."""
    u = -np.log(ends[:, None] - t)
    weight = 1.0 / v
    du = u - (u @ weight / weight.sum())[:, None]
    dx = x - np.average(x, weights=weight)
    slope = (du * dx) @ weight / (du**2 @ weight)
    rest: Float = (dx - slope[:, None] * du) ** 2 @ weight
    return rest


def _not(reason: str) -> FailureTime:
    return FailureTime(None, None, f"not computable: {reason}")
