"""Robust alignment of two surfaces from coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float, Index
from ..core.errors import InputError
from ..core.progress import Progress
from ..geometry.pose import Pose
from ..geometry.voxels import block_numbers
from .moving_places import Places, moving_places
from .observability import (
    Estimate,
    Information,
    curvature_folds,
    estimate,
    information,
    probing_motions,
    unknown_motion,
)
from .point_to_plane import TUKEY, Matcher, Pairs, regional_weights, tukey_weights
from .restarts import MIN_PAIRS, Descent, Limits, descend, reconsider
from .surface import Surface

_LEVEL_RATIO = 4.0  # voxels of one level in those of the next finer one
_COARSE_SOURCES, _SOURCES, _CURVATURE_SOURCES = 6_000, 25_000, 15_000
_MANY_SOURCES, _ALL_SOURCES = 75_000, 150_000
_MAX_PRECISE_ERROR_M = 1e-3  # metres; with a smaller standard error of the position there is no need of all points
_MIN_POINTS = 400  # of a coarse level
_MAX_NEWTON_STEPS = 12
_MIN_APART = 2.0  # standard errors; what changes a motion less when left out has not pulled it


@dataclass(frozen=True)
class Alignment:
    """``pose`` moves the moving surface onto the reference; ``scale`` (m) is the noise of its residuals.

    ``radius`` (m) scales rotations in ``information``. ``slid`` is the share of the surface that was left out because
    it moved along itself.
    """

    pose: Pose
    scale: float
    radius: float
    iterations: int
    converged: bool
    information: Information
    slid: float = 0.0


def levels(voxel: float, offset: float) -> list[float]:
    """Voxel sizes from coarse to fine, for an offset of up to ``offset`` metres."""
    sizes = [voxel]
    while sizes[-1] * _LEVEL_RATIO <= offset:
        sizes.append(sizes[-1] * _LEVEL_RATIO)
    return sizes[::-1]


def align(fine: Matcher, parameters: RegistrationParameters, progress: Progress) -> Alignment:
    """Pose of the moving surface on the reference, local coordinates with their origin in the middle of the points.

    Args:
        fine: the surfaces, of the parameters' voxels.
    """
    voxel, offset = parameters.registration_voxel, parameters.maximum_offset
    iterations = parameters.registration_iterations
    best, remaining, reach = Descent(Pose.identity(), offset / 2), iterations, offset
    known = fine.reference.points if fine.stable is None else fine.reference.points[fine.stable]
    later = fine.moving.points if fine.firm is None else fine.moving.points[fine.firm]
    for size in levels(voxel, offset)[:-1]:
        progress.update(0.1, f"registering at {size:g} m")
        coarse = Matcher(Surface(known, size), Surface(later, size), given_radius=fine.radius)
        if min(len(coarse.reference.points), len(coarse.moving.points)) < _MIN_POINTS:
            continue
        limits = Limits(min(30, remaining), reach, agreement=0.5)
        best = descend(coarse, best, coarse.sample(_COARSE_SOURCES), limits)
        remaining = max(1, remaining - best.iterations)
        reach, best = min(reach, 2 * size), replace(best, scale=max(best.scale, size / 4))
    progress.update(0.2, f"registering at {voxel:g} m")
    sources = fine.sample(_SOURCES)
    best = descend(fine, best, sources, Limits(min(40, remaining), reach))
    best = reconsider(fine, best, sources, progress)
    remaining = max(1, remaining - best.iterations)
    found = refine(Refinement(fine, best.scale), best.pose, max(voxel, offset), remaining, progress)
    return replace(found, iterations=iterations - remaining + found.iterations)


@dataclass(frozen=True)
class Steps:
    """``pairs`` are those from which the last step to ``pose`` was taken."""

    pose: Pose
    pairs: Pairs
    used: int
    converged: bool


@dataclass(frozen=True)
class Refinement:
    """The end of a registration, at the final ``scale`` (m) of the residuals; places that have changed are left out as
    a whole, and those that moved along the surface by the weights of ``places``.
    """

    matcher: Matcher
    scale: float
    places: Places | None = None

    @property
    def reach(self) -> float:
        return self.matcher.reach(self.scale)

    @property
    def correlated(self) -> float:
        """Size of the blocks within which residuals may be correlated, metres."""
        return max(min(self._block, self.matcher.radius / 8), 2 * self.matcher.spacing)

    @property
    def _block(self) -> float:
        """Size of the places that are left out as a whole, metres."""
        return max(10 * self.matcher.spacing, TUKEY * self.scale)

    def weights(self, pairs: Pairs) -> Float:
        weight = tukey_weights(pairs.residual, self.scale) * regional_weights(pairs, self.scale, self._block)
        return weight if self.places is None else weight * self.places.at(pairs.place)

    def curvature(self, pose: Pose, progress: Progress) -> Float:
        """``observability.curvature_folds`` at a pose."""
        matcher = self.matcher
        few = matcher.sample(_CURVATURE_SOURCES)
        done = 0

        def evaluate(motion: Float) -> Estimate:
            nonlocal done
            done += 1
            progress.update(0.4 + 0.3 * done / 13, "measuring what the surface fixes")
            pairs = matcher.match(pose.moved(motion, matcher.radius), few, self.reach)
            return estimate(pairs, self.weights(pairs), matcher.radius, self.correlated)

        pairs = matcher.match(pose, few, self.reach)
        # longer steps stand out from the noise of the planes, but the weights vanish beyond a few scales
        longest = min(2 * self.scale, matcher.spacing / 2)
        motions = probing_motions(pairs.jacobian(matcher.radius), self.weights(pairs), self.scale, longest)
        return curvature_folds(evaluate, motions)

    def information(self, folds: Float, pairs: Pairs, offset: float, free: Float | None = None) -> Information:
        """``observability.information`` for the final pairs.

        Args:
            folds: as of ``curvature``.
            offset: largest expected one, metres.
            free: (6, k) the directions that it is about; all without it.
        """
        terms = pairs.jacobian(self.matcher.radius) * (self.weights(pairs) * pairs.gap)[:, None]
        unknown = unknown_motion(offset)
        if free is not None:
            folds, terms = np.einsum("ia,fij,jb->fab", free, folds, free), terms @ free
            unknown = free.T @ unknown @ free
        blocks = block_numbers(pairs.place, self.correlated)
        return information(folds, terms, blocks, self.matcher.spacing / 2, unknown)

    def steps(
        self,
        pose: Pose,
        sources: tuple[Index, Index],
        found: Information,
        limit: int,
        progress: Progress,
        *,
        error: float = 0.0,
        newton: bool = False,
    ) -> Steps:
        """At most ``limit`` steps of Newton, or of Gauss and Newton, in the observable directions.

        Args:
            error: standard error of the position, metres: much shorter steps end the search.

        Raises:
            InputError: a step, or what nothing fixes, has taken the surfaces apart.
        """
        for used in range(1, max(limit, 1) + 1):
            progress.update(0.7 + 0.25 * (used - 1) / max(limit, 1), "registering with all points")
            pairs = self.matcher.match(pose, sources, self.reach)
            _require(pairs)
            jacobian, weight = pairs.jacobian(self.matcher.radius), self.weights(pairs)
            gradient = jacobian.T @ (weight * pairs.gap)
            if newton:
                step = found.step(gradient, len(pairs))
            else:
                step = found.damped_step(gradient, jacobian.T @ (jacobian * weight[:, None]))
            length, longest = float(np.linalg.norm(step)), self.matcher.spacing / 2
            if length > longest:
                step *= longest / length
            pose = pose.moved(step, self.matcher.radius)
            # the pairs of the next step are other ones in part: below its own error a step is noise
            if length < max(2e-5, 0.05 * error):
                return Steps(pose, pairs, used, True)
        return Steps(pose, pairs, used, False)

    def settled(
        self, pose: Pose, sources: tuple[Index, Index], found: Information, limit: int, progress: Progress, error: float
    ) -> Steps:
        """Newton's steps, and where they do not end those of Gauss and Newton from the same ``pose``."""
        taken = self.steps(pose, sources, found, min(limit, _MAX_NEWTON_STEPS), progress, error=error, newton=True)
        if taken.converged:
            return taken
        # curvature measured on too rough a surface can mislead; the plain matrix is slow but sure
        again = self.steps(pose, sources, found, min(limit, 2 * _MAX_NEWTON_STEPS), progress, error=error)
        return replace(again, used=taken.used + again.used)


def observe(matcher: Matcher, pose: Pose, scale: float, offset: float, progress: Progress) -> Information:
    """What the surfaces fix at a pose that another method found, where their noise is ``scale`` metres."""
    last = Refinement(matcher, scale)
    pairs = matcher.match(pose, matcher.sample(_ALL_SOURCES), last.reach)
    return last.information(last.curvature(pose, progress), pairs, offset)


def refine(last: Refinement, pose: Pose, offset: float, limit: int, progress: Progress) -> Alignment:
    """At most ``limit`` Newton's steps with all points and with neighbourhoods that have changed left out."""
    matcher = last.matcher
    _require(matcher.match(pose, matcher.sample(_CURVATURE_SOURCES), last.reach))
    folds = last.curvature(pose, progress)
    for limited in (_MANY_SOURCES, _ALL_SOURCES):
        sources = matcher.sample(limited)
        pairs = matcher.match(pose, sources, last.reach)
        found = last.information(folds, pairs, offset)
        error = float(np.sqrt(np.trace(found.observable_covariance)))
        if error < _MAX_PRECISE_ERROR_M:
            break
    if not found.observable.all():
        # motions that the surfaces do not fix stay as surveyed
        pose = Pose.from_vector(found.held(pose.vector(matcher.radius)), matcher.radius)
    taken = last.settled(pose, sources, found, limit, progress, error)
    found = last.information(folds, taken.pairs, offset)
    return Alignment(taken.pose, last.scale, matcher.radius, taken.used, taken.converged, found)


def without_slides(matcher: Matcher, first: Alignment, offset: float, progress: Progress) -> Alignment:
    """``first`` where nothing slid; else without the places that slid along the surface against the rest, and with the
    error that slides make which are too small to be seen. Places that sank are left out where they pulled.

    Args:
        offset: largest expected one, metres.
    """
    if not first.information.observable.all():
        return first
    progress.update(0.95, "looking for places that slid")
    for moving in moving_places(matcher, first.pose, first.information):
        last = Refinement(matcher, first.scale, moving.places)
        try:
            found = _without(last, replace(first, pose=moving.pose), offset, progress)
        except InputError:  # too little is left
            continue
        if not found.information.observable.all():
            continue
        found = replace(found, information=found.information.wider(moving.unseen), slid=moving.slid)
        pulled = found.converged and moving.along(first.pose, found.pose) and _apart(first, found) > _MIN_APART
        if moving.certain or pulled:
            return found
    return first


def _apart(first: Alignment, found: Alignment) -> float:
    """How many standard errors of ``found`` two alignments are apart."""
    away = found.pose.vector(found.radius) - first.pose.vector(found.radius)
    return float(np.sqrt(away @ np.linalg.solve(found.information.covariance, away)))


def _without(last: Refinement, first: Alignment, offset: float, progress: Progress) -> Alignment:
    """``first`` by all places but those that moved along the surface."""
    sources = last.matcher.sample(_MANY_SOURCES)
    folds = last.curvature(first.pose, progress)
    found = last.information(folds, last.matcher.match(first.pose, sources, last.reach), offset)
    error = float(np.sqrt(np.trace(found.observable_covariance)))
    taken = last.settled(first.pose, sources, found, 2 * _MAX_NEWTON_STEPS, progress, error)
    return replace(
        first,
        pose=taken.pose,
        iterations=first.iterations + taken.used,
        converged=taken.converged,
        information=last.information(folds, taken.pairs, offset),
    )


def _require(pairs: Pairs) -> None:
    """Raise InputError if there are too few pairs to register by."""
    if len(pairs) < MIN_PAIRS:
        raise InputError(
            "The epochs hardly share any surface to register by; check that both cover the same slope, or raise "
            "maximum_offset."
        )
