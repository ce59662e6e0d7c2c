"""Robust alignment of two surfaces from coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Float, Index
from ..core.errors import InputError
from ..core.progress import Progress
from ..geometry.pose import Pose
from ..geometry.voxels import block_numbers
from .observability import Estimate, Information, curvature_folds, estimate, information, probing_motions
from .point_to_plane import TUKEY, Matcher, Pairs, regional_weights, tukey_weights
from .restarts import LEAST_PAIRS, Descent, descend, reach_of, reconsider
from .surface import Surface

_LEVEL_RATIO = 4.0  # voxels of one level in those of the next finer one
_COARSE_SOURCES, _SOURCES, _CURVATURE_SOURCES = 6_000, 25_000, 15_000
_MANY_SOURCES, _ALL_SOURCES = 75_000, 150_000
_MAX_PRECISE_ERROR_M = 1e-3  # metres; with a smaller standard error of the position there is no need of all points
_MIN_POINTS = 400  # of a coarse level
_MAX_NEWTON_STEPS = 12


@dataclass(frozen=True)
class Alignment:
    """``pose`` moves the moving surface onto the reference; ``scale`` (m) is the noise of its residuals.

    ``radius`` (m) scales rotations in ``information``.
    """

    pose: Pose
    scale: float
    radius: float
    iterations: int
    converged: bool
    information: Information


def levels(voxel: float, offset: float) -> list[float]:
    """Voxel sizes from coarse to fine, for an offset of up to ``offset`` metres."""
    sizes = [voxel]
    while sizes[-1] * _LEVEL_RATIO <= offset:
        sizes.append(sizes[-1] * _LEVEL_RATIO)
    return sizes[::-1]


def radius_of(surface: Surface) -> float:
    """Typical distance of a surface's points from the origin, metres, not affected by stray points."""
    return 1.2 * float(np.median(np.linalg.norm(surface.points, axis=1)))


def align(
    fine: Matcher,
    *,
    voxel: float,
    offset: float,
    iterations: int,
    progress: Progress,
) -> Alignment:
    """Pose of the moving surface on the reference, local coordinates with their origin amidst the points.

    Args:
        fine: the surfaces.
        voxel: theirs, in metres.
        offset: largest expected offset, metres.
        iterations: upper limit.
    """
    radius = radius_of(fine.reference)
    best, remaining, reach = Descent(Pose.identity(), offset / 2), iterations, offset
    known = fine.reference.points if fine.stable is None else fine.reference.points[fine.stable]
    later = fine.moving.points if fine.firm is None else fine.moving.points[fine.firm]
    for size in levels(voxel, offset)[:-1]:
        progress.update(0.1, f"registering at {size:g} m")
        coarse = Matcher(Surface(known, size), Surface(later, size))
        if min(len(coarse.reference.points), len(coarse.moving.points)) < _MIN_POINTS:
            continue
        best = descend(
            coarse,
            best.pose,
            coarse.sample(_COARSE_SOURCES),
            radius,
            scale=best.scale,
            offset=reach,
            agreement=0.5,
            iterations=min(30, remaining),
        )
        remaining = max(1, remaining - best.iterations)
        reach, best = min(reach, 2 * size), replace(best, scale=max(best.scale, size / 4))
    progress.update(0.2, f"registering at {voxel:g} m")
    sources = fine.sample(_SOURCES)
    best = descend(
        fine,
        best.pose,
        sources,
        radius,
        scale=best.scale,
        offset=reach,
        agreement=0.8,
        iterations=min(40, remaining),
    )
    best = reconsider(fine, best, sources, radius, progress)
    remaining = max(1, remaining - best.iterations)
    found = refine(fine, best.pose, best.scale, radius, max(voxel, offset), remaining, progress)
    return replace(found, iterations=iterations - remaining + found.iterations)


@dataclass(frozen=True)
class Weighting:
    """Weights of pairs at the final ``scale``; places of size ``block`` that have changed are left out as a whole."""

    matcher: Matcher
    scale: float

    @property
    def reach(self) -> float:
        return reach_of(self.matcher, self.scale)

    @property
    def spacing(self) -> float:
        return max(self.matcher.reference.spacing, self.matcher.moving.spacing)

    @property
    def block(self) -> float:
        return max(10 * self.spacing, TUKEY * self.scale)

    def correlated(self, radius: float) -> float:
        """Size of the blocks within which residuals may be correlated, metres."""
        return max(min(self.block, radius / 8), 2 * self.spacing)

    def __call__(self, pairs: Pairs) -> Float:
        return tukey_weights(pairs.residual, self.scale) * regional_weights(pairs, self.scale, self.block)


def curvature_at(pose: Pose, weigh: Weighting, radius: float, progress: Progress) -> Float:
    """``observability.curvature_folds`` at a pose."""
    matcher = weigh.matcher
    few = matcher.sample(_CURVATURE_SOURCES)
    done = 0

    def evaluate(motion: Float) -> Estimate:
        nonlocal done
        done += 1
        progress.update(0.4 + 0.3 * done / 13, "measuring what the surface fixes")
        pairs = matcher.match(pose.moved(motion, radius), few, weigh.reach)
        return estimate(pairs, weigh(pairs), radius, weigh.correlated(radius))

    pairs = matcher.match(pose, few, weigh.reach)
    # longer steps stand out from the noise of the planes, but the weights let go beyond a few scales
    motions = probing_motions(
        pairs.jacobian(radius), weigh(pairs), weigh.scale, min(2 * weigh.scale, weigh.spacing / 2)
    )
    return curvature_folds(evaluate, motions)


def information_at(folds: Float, pairs: Pairs, weigh: Weighting, radius: float, offset: float) -> Information:
    """``observability.information`` for the final pairs; ``offset`` (m) is the largest expected one."""
    terms = pairs.jacobian(radius) * (weigh(pairs) * pairs.gap)[:, None]
    blocks = block_numbers(pairs.place, weigh.correlated(radius))
    return information(folds, terms, blocks, weigh.spacing / 2, offset / float(np.sqrt(3.0)))


def observe(matcher: Matcher, pose: Pose, scale: float, offset: float, progress: Progress) -> Information:
    """What the surfaces fix at a pose that another method found, where their noise is ``scale`` metres."""
    weigh, radius = Weighting(matcher, scale), radius_of(matcher.reference)
    pairs = matcher.match(pose, matcher.sample(_ALL_SOURCES), weigh.reach)
    return information_at(curvature_at(pose, weigh, radius, progress), pairs, weigh, radius, offset)


def refine(
    matcher: Matcher, pose: Pose, scale: float, radius: float, offset: float, limit: int, progress: Progress
) -> Alignment:
    """At most ``limit`` Newton's steps with all points and with neighbourhoods that have changed left out."""
    weigh = Weighting(matcher, scale)
    _require(matcher.match(pose, matcher.sample(_CURVATURE_SOURCES), weigh.reach))
    folds = curvature_at(pose, weigh, radius, progress)
    for limited in (_MANY_SOURCES, _ALL_SOURCES):
        sources = matcher.sample(limited)
        pairs = matcher.match(pose, sources, weigh.reach)
        found = information_at(folds, pairs, weigh, radius, offset)
        error = float(np.sqrt(np.trace(found.observable_covariance)))
        if error < _MAX_PRECISE_ERROR_M:
            break
    if not found.observable.all():
        # what nothing fixes stays as surveyed
        pose = Pose.from_vector(found.held(pose.vector(radius)), radius)
    newton = take_steps(
        weigh, pose, sources, radius, found, error, _MAX_NEWTON_STEPS, min(limit, _MAX_NEWTON_STEPS), progress
    )
    if not newton.converged:
        # curvature measured on too rough a surface can mislead; the plain matrix is slow but sure
        again = take_steps(weigh, pose, sources, radius, found, error, 0, min(limit, 2 * _MAX_NEWTON_STEPS), progress)
        newton = replace(again, used=newton.used + again.used)
    found = information_at(folds, newton.pairs, weigh, radius, offset)
    return Alignment(newton.pose, scale, radius, newton.used, newton.converged, found)


@dataclass(frozen=True)
class Steps:
    """``pairs`` are those from which the last step to ``pose`` was taken."""

    pose: Pose
    pairs: Pairs
    used: int
    converged: bool


def take_steps(
    weigh: Weighting,
    pose: Pose,
    sources: tuple[Index, Index],
    radius: float,
    found: Information,
    error: float,
    newton: int,
    limit: int,
    progress: Progress,
) -> Steps:
    """Newton's steps, after the first ``newton`` ones Gauss and Newton's, in the observable directions.

    Raises:
        InputError: a step, or what nothing fixes, has taken the surfaces apart.
    """
    for used in range(1, max(limit, 1) + 1):
        progress.update(0.7 + 0.25 * (used - 1) / max(limit, 1), "registering with all points")
        pairs = weigh.matcher.match(pose, sources, weigh.reach)
        _require(pairs)
        jacobian, weight = pairs.jacobian(radius), weigh(pairs)
        gradient = jacobian.T @ (weight * pairs.gap)
        if used <= newton:
            step = found.step(gradient, len(pairs))
        else:
            step = found.damped_step(gradient, jacobian.T @ (jacobian * weight[:, None]))
        length = float(np.linalg.norm(step))
        if length > weigh.spacing / 2:
            step *= weigh.spacing / 2 / length
        pose = pose.moved(step, radius)
        # the pairs of the next step are other ones in part: below its own error a step is noise
        if length < max(2e-5, 0.05 * error):
            return Steps(pose, pairs, used, True)
    return Steps(pose, pairs, used, False)


def _require(pairs: Pairs) -> None:
    """Raise InputError if there are too few pairs to register by."""
    if len(pairs) < LEAST_PAIRS:
        raise InputError(
            "The epochs hardly share any surface to register by; check that both cover the same slope, or raise "
            "maximum_offset."
        )
