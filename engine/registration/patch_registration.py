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
from .stable_patches import StablePart, stable_part
from .surface_patches import Patches

_SOURCES = 60_000


@dataclass(frozen=True)
class OnPatches:
    """A registration on the stable ``part`` alone; ``matcher`` compares it, ``among`` (m,) are its moving points."""

    alignment: Alignment
    standing: Standing
    matcher: Matcher
    among: Bool

    @property
    def part(self) -> StablePart:
        return self.standing.part


def align_on_patches(
    matcher: Matcher, patches: Patches, found: Alignment, parameters: RegistrationParameters, progress: Progress
) -> OnPatches | None:
    """Find the stable part and register on it, contested or not; None where there is none.

    Args:
        patches: of the moving surface.
        found: by all ground together.
    """
    progress.update(0.1, "looking for patches that did not move")
    part = stable_part(matcher, patches, (Pose.identity(), found.pose), parameters.maximum_offset)
    judged = None if part is None else standing(part, matcher.radius)
    if judged is None or not (judged.known or judged.contested):
        return None
    part = judged.part
    progress.update(0.5, "registering on what did not move")
    among = part.points(len(matcher.moving.points))
    narrow = Matcher(matcher.reference, matcher.moving, _beneath(matcher, part.pose, among), among)
    pairs = narrow.match(part.pose, narrow.sample(_SOURCES), narrow.reach(matcher.noise))
    if not len(pairs):
        return None
    scale = max(min(robust_scale(pairs.residual), 3 * matcher.noise), 1e-3)
    alignment = Alignment(part.pose, scale, matcher.radius, found.iterations, True, part.information)
    return OnPatches(alignment, judged, narrow, among)


def _beneath(matcher: Matcher, pose: Pose, among: Bool) -> Bool:
    """(n,) points of the reference that have a point of ``among`` as their nearest neighbour."""
    everything = np.arange(len(matcher.reference.points), dtype=np.int64)
    distance, number = matcher.neighbours_back(pose, everything, matcher.reach(matcher.noise))
    near = np.isfinite(distance)
    near[near] = among[number[near]]
    return near if matcher.stable is None else near & matcher.stable
