"""The tangent angle of a zone's displacement over time, as a ratio of velocities, which suits sparse surveys."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..statistics.normal import Z95
from .velocity import fit_line

ORANGE_RATIO, RED_RATIO = math.tan(math.radians(80.0)), math.tan(math.radians(85.0))  # 5.7 and 11.4
LEVELS = ("blue", "yellow", "orange", "red")


@dataclass(frozen=True)
class TangentAngle:
    """``degrees`` of arctan(v / v0) and ``level`` (one of ``LEVELS``); None and "" where it is ``reason`` why not.

    ``low`` and ``high`` are the 95 % interval of ``degrees``.
    """

    degrees: float | None
    low: float | None
    high: float | None
    level: str
    reason: str


def tangent_angle(days: Float, change: Float, variance: Float, start: int = 0) -> TangentAngle:
    """Angle of the last interval's velocity v against the steady velocity v0 before: tan(angle) = v / v0.

    With equal velocities the angle is 45 degrees: blue. Yellow: v is larger than v0 beyond chance (95 %) and below
    tan 80 degrees = 5.7 times v0; orange from there; red from tan 85 degrees = 11.4 times.

    Args:
        days, change, variance: as for ``zone_velocity``, (n,) each.
        start: index of the first survey in motion. v0 comes from the surveys from there to the last but one.

    Source: Xu, Zeng, Qian et al. 2009, on the criterion of the tangential angle; the ratio of velocities serves where a
    curve is too sparse to draw a tangent.
    """
    known = np.isfinite(change) & np.isfinite(variance) & (variance > 0)
    known[:start] = False
    t, x, v = days[known], change[known], variance[known]
    if len(t) < 4:
        return _not(f"{len(t)} surveys in motion, at least 4 are needed")
    steady = fit_line(t[:-1], x[:-1], v[:-1])
    if abs(steady.slope) <= Z95 * steady.error:
        return _not("the velocity before is not above its level of detection")
    last = float(x[-1] - x[-2]) / float(t[-1] - t[-2])
    low, high = _fieller(t, v, last, steady.slope)
    ratio = last / steady.slope
    level = "blue"
    if low > 1.0:
        level = "red" if ratio >= RED_RATIO else "orange" if ratio >= ORANGE_RATIO else "yellow"
    degrees, least, most = (math.degrees(math.atan(r)) for r in (ratio, low, high))
    return TangentAngle(degrees, least, most, level, "")


def _fieller(t: Float, v: Float, last: float, steady: float) -> tuple[float, float]:
    """95 % interval of last / steady, both linear in the same surveys' changes (Fieller 1954)."""
    own = np.zeros(len(t))
    own[-2:] = np.array([-1.0, 1.0]) / (t[-1] - t[-2])
    weight = 1.0 / v[:-1]
    centred = t[:-1] - np.average(t[:-1], weights=weight)
    line = np.append(weight * centred / np.sum(weight * centred**2), 0.0)
    aa, ab, bb = (Z95**2 * float(np.sum(g * h * v)) for g, h in ((own, own), (own, line), (line, line)))
    # all r with (last - r steady)² <= aa - 2 r ab + r² bb; steady is significant, so that the square term is positive
    square, middle, rest = steady**2 - bb, last * steady - ab, last**2 - aa
    root = math.sqrt(max(middle**2 - square * rest, 0.0))
    return (middle - root) / square, (middle + root) / square


def _not(reason: str) -> TangentAngle:
    return TangentAngle(None, None, None, "", f"not computable: {reason}")
