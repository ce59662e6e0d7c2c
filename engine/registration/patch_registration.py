"""Registration on the largest part of a surface that agrees on one motion, where much of the rest has moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Bool
from ..core.progress import Progress
from ..geometry.pose import Pose
from ..statistics.robust import robust_scale
from .alignment import Alignment
from .point_to_plane import Matcher
from .rival_parts import Standing, standing
from .stable_patches import StablePart, agreeing, stable_part

MIN_SHARE_WITHOUT_PATCHES = 0.75
"""Share of the overlap that agrees with a registration, from which there is no need to look at patches."""
_MIN_AGREEING_SHARE, _MAX_PATCH_SHARE_RATIO = 0.5, 0.75
_MIN_CONTRADICTING_SHARE, _MIN_STILL_SHARE = 0.35, 0.9
_SOURCES = 60_000


@dataclass(frozen=True)
class OnPatches:
    """A registration on the stable ``part`` alone; ``matcher`` compares it, ``among`` (m,) are its moving points.

    ``still``: share of the part that agrees with the registration by all ground too.
    """

    alignment: Alignment
    standing: Standing
    matcher: Matcher
    among: Bool
    still: float

    @property
    def part(self) -> StablePart:
        return self.standing.part


def keeps(share: float, on_patches: float, patches: OnPatches) -> bool:
    """Whether a registration by all ground is kept, of which ``share`` agrees, where patches take ``on_patches`` as
    stable.

    Rough ground, of which few patches agree closely, has not moved for that. But a scale as wide as an error of the
    registration calls that error agreement: what many patches contradict is not kept.
    """
    contradicted = patches.part.share >= _MIN_CONTRADICTING_SHARE and patches.still < _MIN_STILL_SHARE
    return share >= _MIN_AGREEING_SHARE and on_patches < _MAX_PATCH_SHARE_RATIO * share and not contradicted


def align_on_patches(
    matcher: Matcher, found: Alignment | None, parameters: RegistrationParameters, progress: Progress
) -> OnPatches | None:
    """Find the stable part and register on it, contested or not; None where there is none.

    Args:
        found: by all ground together.
    """
    starts = (Pose.identity(),) if found is None else (Pose.identity(), found.pose)
    progress.update(0.1, "looking for patches that did not move")
    part = stable_part(matcher, starts, parameters.maximum_offset)
    judged = None if part is None else standing(part)
    if judged is None or not (judged.known or judged.contested):
        return None
    part = judged.part
    still = 0.0 if found is None else agreeing(matcher, part, found.pose)
    progress.update(0.5, "registering on what did not move")
    among = part.points(len(matcher.moving.points))
    narrow = Matcher(matcher.reference, matcher.moving, _beneath(matcher, part.pose, among), among)
    pairs = narrow.match(part.pose, narrow.sample(_SOURCES), narrow.reach(matcher.noise))
    if not len(pairs):
        return None
    scale = max(min(robust_scale(pairs.residual), 3 * matcher.noise), 1e-3)
    done = 0 if found is None else found.iterations
    return OnPatches(
        Alignment(part.pose, scale, matcher.radius, done, True, part.information), judged, narrow, among, still
    )


def _beneath(matcher: Matcher, pose: Pose, among: Bool) -> Bool:
    """(n,) points of the reference that have a point of ``among`` as their nearest neighbour."""
    everything = np.arange(len(matcher.reference.points), dtype=np.int64)
    distance, number = matcher.neighbours_back(pose, everything, matcher.reach(matcher.noise))
    near = np.isfinite(distance)
    near[near] = among[number[near]]
    return near if matcher.stable is None else near & matcher.stable
