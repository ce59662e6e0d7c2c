"""Registration on the largest part of a surface that agrees on one motion, where much of the rest has moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Bool
from ..core.progress import Progress
from ..geometry.pose import Pose
from .alignment import Alignment, radius_of
from .point_to_plane import Matcher, robust_scale
from .restarts import own_noise, reach_of
from .stable_patches import StablePart, stable_part

ENOUGH = 0.75
"""Share of the overlap that agrees with a registration, from which there is no need to look at patches."""
_LEAST_SHARE = 0.10  # of the patches' area: by chance as much agrees with some motion of three that moved apart
_RIVAL = 0.7  # of the largest part: another one as large contradicts it
_SURE_RIVAL = 0.55  # the same of a small part
_SMALL = 0.2
_MOST, _LOST = 0.5, 0.75
_SOURCES = 60_000


@dataclass(frozen=True)
class OnPatches:
    """A registration on the stable ``part`` alone; ``matcher`` compares it, ``among`` (m,) are its moving points."""

    alignment: Alignment
    part: StablePart
    matcher: Matcher
    among: Bool


def is_clear(part: StablePart) -> bool:
    """Whether a part is large enough, and so much larger than any other, that it is what did not move."""
    rival = part.rival / max(part.share, 1e-9)
    return part.share >= _LEAST_SHARE and rival <= (_SURE_RIVAL if part.share < _SMALL else _RIVAL)


def keeps(share: float, on_patches: float) -> bool:
    """Whether a registration by all ground stands, of which ``share`` agrees, where patches take so much as stable.

    Rough ground, of which few patches agree closely, has not moved for that.
    """
    return share >= _MOST and on_patches < _LOST * share


def align_on_patches(
    matcher: Matcher, found: Alignment | None, parameters: RegistrationParameters, progress: Progress
) -> OnPatches | None:
    """Find the stable part and register on it; None where no part is clearly the one that did not move.

    Args:
        found: by all ground together.
    """
    radius = radius_of(matcher.reference)
    noise = max(own_noise(matcher.reference), own_noise(matcher.moving))
    starts = (Pose.identity(),) if found is None else (Pose.identity(), found.pose)
    progress.update(0.1, "looking for patches that did not move")
    part = stable_part(matcher, starts, noise=noise, offset=parameters.maximum_offset, radius=radius)
    if part is None or not is_clear(part):
        return None
    progress.update(0.5, "registering on what did not move")
    among = part.points(len(matcher.moving.points))
    narrow = Matcher(matcher.reference, matcher.moving, _beneath(matcher, part.pose, among, noise), among)
    pairs = narrow.match(part.pose, narrow.sample(_SOURCES), reach_of(narrow, noise))
    if not len(pairs):
        return None
    scale = max(min(robust_scale(pairs.residual), 3 * noise), 1e-3)
    done = 0 if found is None else found.iterations
    return OnPatches(Alignment(part.pose, scale, radius, done, True, part.information), part, narrow, among)


def _beneath(matcher: Matcher, pose: Pose, among: Bool, noise: float) -> Bool:
    """(n,) points of the reference that have a point of ``among`` as their nearest neighbour."""
    everything = np.arange(len(matcher.reference.points), dtype=np.int64)
    distance, number = matcher.neighbours_back(pose, everything, reach_of(matcher, noise))
    near = np.isfinite(distance)
    near[near] = among[number[near]]
    return near if matcher.stable is None else near & matcher.stable
