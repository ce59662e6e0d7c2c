"""How far the patches of a surface agree with a pose: by their own precision, and with what has left its place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from ..geometry.pose import Pose
from .part_information import CORRELATED
from .point_to_plane import Matcher
from .surface_patches import Equations, Patches, equations

FINAL_POINTS = 60
"""Points of a patch that are paired where a pose is judged."""
MIN_ERROR_M = 5e-4
"""Metres; no two surveys of a surface agree better."""
_MIN_PAIRS = 12
_MAX_STANDARD_ERRORS = 2.5
REACH_SPACINGS = 3.0


@dataclass(frozen=True)
class PatchAgreement:
    """Which patches (k,) can be ``compared`` at a pose, which of them agree, and which have ``left``.

    A patch has left if it lies above or below the reference and has no counterpart near it.
    """

    area: Float
    agrees: Bool
    compared: Bool
    left: Bool

    @property
    def judged(self) -> float:
        """Share of the patches' area of which it is known whether it agrees."""
        return float(self.area[self.compared | self.left].sum() / max(float(self.area.sum()), 1e-9))

    @property
    def share(self) -> float:
        """Area that agrees by the area that is ``judged``."""
        return float(self.area[self.agrees].sum() / max(float(self.area[self.compared | self.left].sum()), 1e-9))

    def share_of(self, among: Bool) -> float:
        """Share of the compared patches ``among`` (k,) that agree."""
        some = among & self.compared
        return float(self.area[some & self.agrees].sum() / max(float(self.area[some].sum()), 1e-9))


def patch_agreement(matcher: Matcher, patches: Patches, pose: Pose) -> PatchAgreement:
    system = equations(matcher, patches, pose, REACH_SPACINGS * matcher.spacing, FINAL_POINTS)
    level, compared = levels(system, matcher.noise, 1.0)
    agrees = compared & (system.excess(np.zeros((1, 6)))[:, 0] < level)
    return PatchAgreement(patches.area, agrees, compared, left_behind(matcher, patches, pose, system))


def left_behind(matcher: Matcher, patches: Patches, pose: Pose, system: Equations) -> Bool:
    """(k,) patches over the reference without a counterpart within the reach of the ``system`` at the pose.

    They moved farther. To compare only what lies near would count them as not seen.
    """
    away = np.flatnonzero(system.pairs < _MIN_PAIRS)
    left = np.zeros(len(patches), dtype=bool)
    if not len(away):
        return left
    known = matcher.reference.points if matcher.stable is None else matcher.reference.points[matcher.stable]
    plan, places = cKDTree(known[:, :2]), pose.apply(patches.centre[away])
    left[away] = plan.query(places[:, :2])[0] < REACH_SPACINGS * matcher.spacing
    # a neighbour that is near, but faces another way or is no plane, says nothing
    distance = matcher.reference.tree.query(places)[0]
    left[away] &= distance > REACH_SPACINGS * matcher.spacing
    return left


def levels(system: Equations, noise: float, strict: float) -> tuple[Float, Bool]:
    """Squared distance (k,) from which a patch has moved, by its points' scatter; which patches are precise enough to
    decide (k,).
    """
    error = 6 * system.rest * CORRELATED / np.maximum(system.pairs, 1)
    decisive = (system.pairs >= _MIN_PAIRS) & (error < max(noise, 2 * MIN_ERROR_M) ** 2)
    return np.asarray(_MAX_STANDARD_ERRORS**2 * (error + (strict * max(noise / 4, MIN_ERROR_M)) ** 2)), decisive
