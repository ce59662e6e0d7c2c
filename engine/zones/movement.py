"""What a zone did: whether its ground sank, bulged, slid, or lost or gained material, with the error of saying so.

Three measurements say it together. The distance along the normal (M3C2) says that the surface is elsewhere, the motion
along the surface that the ground has moved there, and the likeness of the relief whether it is still the same ground:
where material left or came, another surface lies open. The change of heights alone knows none of this.

Nested models of the motion are tested. Ground that sinks or bulges moves straight up or down, or along the normal, or
between the two; only what that does not explain is sliding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc, ndtr

from ..core.arrays import Float
from ..displacement.gravity import is_uphill

SANK, BULGED, SLID, LOST, GAINED, UNDECIDED = "sank", "bulged", "slid", "lost", "gained", "undecided"
MOVEMENTS = (SLID, SANK, BULGED, LOST, GAINED, UNDECIDED)
KEPT_SHARE = 0.5
"""Of the likeness of the relief around: below, the ground is not taken as the same."""
_SURE = 0.95
_UNEVEN_SHARE = 0.3
"""Standard error along the surface of ground that moves along its normal, as a share of that: no bulge rises evenly."""
_SEEN_ERRORS = 1.0
"""Errors of the motion along the surface that the one along the normal must exceed, for sliding to be ruled out."""


@dataclass(frozen=True)
class Evidence:
    """What was measured of a piece of ground.

    Attributes:
        normal, normal_error: motion along the normal and its standard error, metres; positive outwards.
        along: (2,) motion down the dip and across it, metres; None where relief does not hold it.
        covariance: (2, 2) of it with the registration's error, m².
        kept, kept_error: likeness of its relief in both surveys by that of the relief around, and its standard error;
            NaN where there is no relief to compare.
        slope_deg: of the ground, degrees.
    """

    normal: float
    normal_error: float
    along: Float | None
    covariance: Float | None
    kept: float
    kept_error: float
    slope_deg: float


@dataclass(frozen=True)
class Verdict:
    """What a zone did: one of ``MOVEMENTS``; ``confidence`` (0 to 1) with which the other models are refused."""

    movement: str
    confidence: float


def sliding_probability(along: Float, normal: float, covariance: Float, slope_deg: float) -> float:
    """Probability that ground which only sinks or bulges shows such a motion.

    Args:
        along: (2,) down the dip and across it, metres.
        covariance: (3, 3) of ``along`` and ``normal``, m².
    """
    tangent = math.tan(math.radians(min(slope_deg, 85.0)))

    def statistic(share: float) -> float:
        # of ground that moves by n along the normal, -n tan(slope) down the dip makes its motion vertical
        to_rest = np.array([[1.0, 0.0, share * tangent], [0.0, 1.0, 0.0]])
        off = to_rest @ np.append(along, normal)
        return float(off @ np.linalg.solve(to_rest @ covariance @ to_rest.T, off))

    least = min(statistic(0.0), statistic(1.0))
    found = minimize_scalar(statistic, bounds=(0.0, 1.0), method="bounded")
    return float(chdtrc(2, min(least, float(found.fun))))


def decide(evidence: Evidence, confidence: float = 0.99) -> Verdict:
    """What the ground did; ``undecided`` where the measurements do not tell.

    Args:
        confidence: with which ground that did not slide is not said to have slid, and the like.
    """
    by_chance = 1.0 - confidence
    sure_of_normal = 1.0 - 2.0 * float(ndtr(-abs(evidence.normal) / max(evidence.normal_error, 1e-9)))
    same = _same_ground(evidence)
    if same is None:
        return Verdict(UNDECIDED, 0.0)
    if same < 1.0 - _SURE:
        if sure_of_normal < confidence:
            return Verdict(UNDECIDED, sure_of_normal)
        return Verdict(LOST if evidence.normal < 0 else GAINED, min(sure_of_normal, 1.0 - same))
    if same < 0.5 or evidence.along is None or evidence.covariance is None:
        return Verdict(UNDECIDED, 0.0)
    whole = np.zeros((3, 3))
    uneven = (_UNEVEN_SHARE * evidence.normal) ** 2
    whole[:2, :2], whole[2, 2] = evidence.covariance + uneven * np.eye(2), evidence.normal_error**2
    without_sliding = sliding_probability(evidence.along, evidence.normal, whole, evidence.slope_deg)
    if without_sliding < by_chance:
        return Verdict(UNDECIDED if _rises(evidence) else SLID, 1.0 - without_sliding)
    unseen = _SEEN_ERRORS * math.sqrt(float(np.linalg.eigvalsh(evidence.covariance)[-1]))
    if sure_of_normal < confidence or unseen > abs(evidence.normal):
        return Verdict(UNDECIDED, sure_of_normal)
    return Verdict(SANK if evidence.normal < 0 else BULGED, min(sure_of_normal, same))


def _rises(evidence: Evidence) -> bool:
    """Whether it moves along the surface against gravity."""
    assert evidence.along is not None
    assert evidence.covariance is not None
    dip = np.array([0.0, 0.0, -math.sin(math.radians(evidence.slope_deg))])
    return bool(is_uphill(dip, evidence.along[0], np.sqrt(evidence.covariance[0, 0])))


def _same_ground(evidence: Evidence) -> float | None:
    """Probability that the relief was kept; None where that is not known."""
    if not (math.isfinite(evidence.kept) and evidence.kept_error > 0):
        return None
    return float(ndtr((evidence.kept - KEPT_SHARE) / evidence.kept_error))
