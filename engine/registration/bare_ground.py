"""Registration where plants hide some of the ground: bare ground fixes what it can, the rest the relief under plants.

The error of a height that plants cause is shared by neighbours, so that no number of points averages it out: grass that
stands 10 cm lower in the later survey would be removed as an offset of the survey. A road, rock or a wall has no such
error. It is registered alone; what it leaves open, such as a slide along a plane road, is fixed by the relief of the
other ground after its common offset has been removed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float, Index
from ..core.progress import Progress
from ..geometry.pose import Pose
from .alignment import Alignment, Refinement, align, without_slides
from .observability import Information
from .point_to_plane import Matcher, Pairs
from .restarts import Descent, Limits, descend

MAX_BARE_PLANT_ERROR_M = 0.01
"""Metres: ground with an error by plants that is no larger counts as bare."""
_MIN_POINTS = 300
_SOURCES = 25_000
_MAX_STEPS = 24
_MAX_OFFSET_SCALES = 5.0  # times the noise of the residuals: how far the registration of all ground may be off
MAX_SCALE_RATIO = 1.2
"""Times the smaller noise of residuals: two places that fit equally well."""
_MIN_UPWARD_NORMAL = 0.2  # least vertical part of a normal: heights of steeper faces are imprecise
_PLACES = 5_000


@dataclass(frozen=True)
class Covered:
    """Two surfaces, compared on ground that is ``bare`` in both surveys, and on ground that is ``covered`` by plants.

    Covered ground is taken from the survey with more of it; ``bare_share`` is the other share of its points.
    """

    bare: Matcher
    covered: Matcher
    bare_share: float


def divide(matcher: Matcher) -> Covered | None:
    """Bare and covered ground of both surfaces; None where nothing is known of plants, or there are hardly any."""
    surfaces = matcher.reference, matcher.moving
    if all(surface.plants is None for surface in surfaces):
        return None
    first, second = (surface.bare(MAX_BARE_PLANT_ERROR_M) for surface in surfaces)
    if first.all() and second.all():
        return None
    known = np.ones_like(first) if matcher.stable is None else matcher.stable
    shares = float(np.mean(first[known])), float(np.mean(second))
    covered = (known & ~first, None) if shares[0] <= shares[1] else (known, ~second)
    return Covered(Matcher(*surfaces, known & first, second), _Levelled(*surfaces, *covered), min(shares))


def align_bare(
    ground: Covered, whole: Alignment, parameters: RegistrationParameters, progress: Progress
) -> Alignment | None:
    """Pose by the bare ground, and in what that leaves open by the relief of the other; None without enough of it.

    Args:
        whole: by all ground together.

    Raises:
        InputError: the two surveys' bare ground is not the same.
    """
    bare = ground.bare
    if min(np.count_nonzero(which) for which in (bare.stable, bare.firm) if which is not None) < _MIN_POINTS:
        return None
    found = without_slides(bare, align(bare, parameters, progress), parameters.maximum_offset, progress)
    if found.information.observable.all():
        return found
    return _completed(found, whole, ground, parameters.maximum_offset, progress)


class _LevelledPairs(Pairs):
    """Pairs without the common difference of their residuals in height, nor any motion as far as it causes one."""

    def jacobian(self, radius: float) -> Float:
        full, upward = super().jacobian(radius), self.normal[:, 2:]
        return full - upward @ (upward.T @ full) / max(float(np.sum(upward**2)), 1e-12)


class _Levelled(Matcher):
    """Surfaces whose common difference in height is left out of the residuals: plants lift the ground upwards."""

    def match(self, pose: Pose, sources: tuple[Index, Index], reach: float, agreement: float = 0.8) -> Pairs:
        pairs = super().match(pose, sources, reach, agreement)
        common = _height(pairs) * pairs.normal[:, 2]
        return _LevelledPairs(pairs.place, pairs.normal, pairs.residual - common, pairs.gap - common, pairs.source)


def _height(pairs: Pairs) -> float:
    """Median difference of heights, metres, of the pairs that are not on a wall; 0 without any."""
    upward = pairs.normal[:, 2]
    open_ground = np.abs(upward) > _MIN_UPWARD_NORMAL
    return float(np.median(pairs.residual[open_ground] / upward[open_ground])) if open_ground.any() else 0.0


def _completed(found: Alignment, whole: Alignment, ground: Covered, offset: float, progress: Progress) -> Alignment:
    """With the motions that ``found`` does not fix taken from covered ground, as far as that fixes them."""
    covered, known = ground.covered, found.information
    last, radius = Refinement(covered, whole.scale), covered.radius
    sources = covered.sample(_SOURCES)
    free = known.directions[:, ~known.observable]
    pose = _slid(found.pose, whole, covered, sources, free)
    if pose is None:
        return found
    folds = last.curvature(pose, progress)

    def information_of(pairs: Pairs) -> Information:
        part = last.information(folds, pairs, offset, free)
        return Information(part.curvature, free @ part.directions, part.observable, free @ part.covariance @ free.T)

    part = information_of(covered.match(pose, sources, last.reach))
    if not part.observable.any():
        return found
    # motions that the surfaces do not fix stay as surveyed
    apart = pose.vector(radius) - found.pose.vector(radius)
    pose = found.pose.moved(part.held(apart), radius)
    slid = last.steps(pose, sources, part, _MAX_STEPS, progress)
    # a long slide along a road that is not quite plane
    own = Refinement(ground.bare, found.scale)
    held = own.steps(slid.pose, ground.bare.sample(_SOURCES), known, _MAX_STEPS, progress)
    return replace(
        found,
        pose=held.pose,
        iterations=found.iterations + slid.used + held.used,
        information=_joined(known, information_of(slid.pairs)),
    )


def _slid(pose: Pose, whole: Alignment, covered: Matcher, sources: tuple[Index, Index], free: Float) -> Pose | None:
    """``pose`` moved in the ``free`` directions (6, k) to where covered ground agrees; None where that is not clear.

    It is looked for from where all ground together lies, which may have slid to where road and grass both fit, and from
    where the surveys are as delivered. Where both ends are equally good at different places, only chance decides
    between them.
    """
    radius, spacing = covered.radius, covered.spacing
    apart = whole.pose.vector(radius) - pose.vector(radius)
    scale, ends = max(_MAX_OFFSET_SCALES * whole.scale, spacing), []
    for start in (pose.moved(free @ (free.T @ apart), radius), pose):
        if len(covered.match(start, sources, covered.reach(whole.scale))) < _MIN_POINTS:
            continue
        ends.append(descend(covered, Descent(start, scale), sources, Limits(_MAX_STEPS), free=free))
    if not ends:
        return None
    ends.sort(key=lambda end: end.scale)
    if len(ends) == 2 and ends[1].scale < MAX_SCALE_RATIO * ends[0].scale:
        away = np.linalg.norm(ends[1].pose.vector(radius) - ends[0].pose.vector(radius))
        if away > spacing / 2:
            return None
    return ends[0].pose


def _joined(known: Information, part: Information) -> Information:
    """What ``known`` fixes, and of the rest what ``part``, which is of that rest alone, fixes."""
    fixed = known.observable
    curvature = np.concatenate([known.curvature[fixed], part.curvature])
    observable = np.concatenate([known.observable[fixed], part.observable])
    order = np.argsort(curvature, kind="stable")
    directions = np.hstack([known.directions[:, fixed], part.directions])
    covariance = known.observable_covariance + part.covariance
    return Information(curvature[order], directions[:, order], observable[order], covariance)


def offset_of_covered(ground: Covered, pose: Pose, reach: float) -> float | None:
    """Median height of the later survey's covered ground over the earlier one's at ``pose``, metres."""
    plain = Matcher(ground.covered.reference, ground.covered.moving, ground.covered.stable, ground.covered.firm)
    pairs = plain.match(pose, plain.sample(_SOURCES), reach, 0.5)
    return _height(pairs) if len(pairs) >= _MIN_POINTS else None


def compared_ground(ground: Covered, pose: Pose, reach: float) -> tuple[Float, Float]:
    """Places of the later survey's points before registration and upward normals there, (n, 3) each, of all ground."""
    whole = Matcher(ground.bare.reference, ground.bare.moving)
    pairs = whole.onto_reference(pose, whole.moving.sample(_PLACES), reach, 0.5)
    upward = np.where(pairs.normal[:, 2:] < 0, -1.0, 1.0)
    return whole.moving.points[pairs.source], pairs.normal * upward
