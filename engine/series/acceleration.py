"""Whether a motion gets faster beyond chance, and whether it has slowed down from such a velocity before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtri

from ..core.arrays import Float
from ..statistics.normal import Z95
from .velocity import ramps

MIN_SURVEYS = 5
"""In motion and before it: a steady motion has three unknowns (place, velocity, onset), and two surveys test it."""
PEAK_FACTOR = 2.0
"""By which a motion must be faster than it was before it slowed down, to count as more than another step."""
_ONSET_COUNT = 400
_STEP_CHANCE = 0.05  # that errors alone make a steady motion look step-like


@dataclass(frozen=True)
class Acceleration:
    """``chance`` that a steady motion, whenever it began, is surveyed like this; 1 where it is not faster.

    ``reason`` says why it is not faster; empty where only the chance decides, which the alert table judges.
    """

    chance: float
    reason: str


def acceleration(days: Float, change: Float, variance: Float) -> Acceleration:
    """Test of a motion that gets faster against rest and then a steady motion, with the onset wherever it fits best.

    Chi-square of the best such motion, with two unknowns beside the place, gives the chance. The surveys' errors are
    independent; those of the velocities between them are not, so the test uses the displacements themselves. The motion
    must also be faster between the last two surveys than between the two before.

    Step-like motion is no acceleration: where an earlier velocity was followed by a smaller one beyond chance, the last
    velocity must be more than ``PEAK_FACTOR`` times the earlier one, beyond chance.

    Args:
        days: (n,) days of the surveys since the first.
        change: (n,) displacement against the first survey, metres; NaN where it was not measured.
        variance: (n,) each survey's own variance, m².
    """
    known = np.isfinite(change) & np.isfinite(variance) & (variance > 0)
    t, x, v = days[known], change[known], variance[known]
    if len(t) < MIN_SURVEYS:
        return Acceleration(1.0, f"{len(t)} surveys, at least {MIN_SURVEYS} are needed")
    step = np.diff(x) / np.diff(t)
    x, step = (x, step) if step[-1] >= 0 else (-x, -step)
    if step[-1] <= Z95 * np.sqrt(v[-1] + v[-2]) / (t[-1] - t[-2]):
        return Acceleration(1.0, "the last velocity is not above its level of detection")
    if step[-1] <= step[-2]:
        return Acceleration(1.0, "the motion does not get faster")
    if not _beyond_peak(t, x, v):
        return Acceleration(1.0, "the motion is step-like: it was as fast before and slowed down again")
    onsets = np.append(t[0], np.linspace(t[0], t[-1], _ONSET_COUNT, endpoint=False)[1:])
    misfit = float(ramps(t, x, v, onsets)[2].min())
    return Acceleration(float(chdtrc(len(t) - 3, misfit)), "")


def _beyond_peak(t: Float, x: Float, v: Float) -> bool:
    """Whether the last velocity is beyond all from which the motion slowed down."""
    dt = np.diff(t)
    forms = (np.eye(len(t))[1:] - np.eye(len(t))[:-1]) / dt[:, None]  # velocities of the displacements
    first, later = np.triu_indices(len(dt) - 1, 1)
    fall = forms[first] - forms[later]
    # of so many pairs none of a steady motion should look like that
    beyond = -ndtri(_STEP_CHANCE / max(len(first), 1))
    slowed = np.unique(first[fall @ x > beyond * np.sqrt(fall**2 @ v)])
    excess = forms[-1] - PEAK_FACTOR * forms[slowed]
    return bool(np.all(excess @ x > Z95 * np.sqrt(excess**2 @ v)))
