"""Robust alignment of two surfaces from coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .observability import Estimate, Information, curvature_folds, estimate, information
from .point_to_plane import TUKEY, Matcher, Pairs, regional_weights, robust_scale, tukey_weights
from .pose import Pose
from .progress import Progress
from .surface import Surface
from .voxel import block_numbers

Float = NDArray[np.float64]
Index = NDArray[np.int64]

_COARSE = 4.0  # voxels of one level in those of the next finer one
_COARSE_SOURCES, _SOURCES, _CURVATURE_SOURCES, _ALL_SOURCES = 6_000, 40_000, 30_000, 150_000
_LEAST_POINTS = 400  # of a coarse level
_SHRINK = 0.3  # smallest factor of the scale from one iteration to the next
_NOISE_FLOOR = 1e-3  # metres; no scanner is better, and a scale of zero has no weights
_NEWTON = 12


@dataclass(frozen=True)
class Alignment:
    """``pose`` moves the moving surface onto the reference; ``scale`` (m) is the noise of its residuals.

    ``radius`` (m) scales rotations in ``information``. ``pairs`` are the final ones and ``weight`` (n,) theirs.
    """

    pose: Pose
    scale: float
    radius: float
    iterations: int
    converged: bool
    information: Information
    pairs: Pairs
    weight: Float


def levels(voxel: float, offset: float) -> list[float]:
    """Voxel sizes from coarse to fine, for an offset of up to ``offset`` metres."""
    sizes = [voxel]
    while sizes[-1] * _COARSE <= offset:
        sizes.append(sizes[-1] * _COARSE)
    return sizes[::-1]


def align(
    reference: Float,
    moving: Float,
    fine: Matcher,
    *,
    voxel: float,
    offset: float,
    iterations: int,
    stable: NDArray[np.bool_] | None,
    progress: Progress,
) -> Alignment:
    """Pose of ``moving`` on ``reference``, local coordinates (n, 3) and (m, 3) with their origin amidst them.

    Args:
        fine: the surfaces at ``voxel``.
        voxel: in metres.
        offset: largest expected offset, metres.
        iterations: upper limit.
        stable: (n,) points of the reference on known ground; None for all.
    """
    radius = float(np.sqrt(np.mean(np.sum(fine.reference.points**2, axis=1))))
    pose, scale, used = Pose.identity(), offset / 2, 0
    known = reference if stable is None else reference[stable]
    for size in levels(voxel, offset)[:-1]:
        progress.update(0.1, f"registering at {size:g} m")
        coarse = Matcher(Surface(known, size), Surface(moving, size))
        if min(len(coarse.reference.points), len(coarse.moving.points)) < _LEAST_POINTS:
            continue
        sources = coarse.sample(_COARSE_SOURCES)
        pose, scale, done = descend(coarse, pose, sources, radius, scale, offset, 0.5, min(30, iterations - used))
        used += done
        offset, scale = min(offset, 2 * size), max(scale, size / 4)
    progress.update(0.3, f"registering at {voxel:g} m")
    sources = fine.sample(_SOURCES)
    pose, scale, done = descend(fine, pose, sources, radius, scale, offset, 0.8, max(1, min(40, iterations - used)))
    return refine(fine, pose, scale, radius, max(voxel, offset), used + done, iterations, progress)


def reach_of(matcher: Matcher, scale: float) -> float:
    """Farthest point of a pair: the next few points, and what the weights do not yet leave out."""
    return max(3 * max(matcher.reference.spacing, matcher.moving.spacing), 3 * scale)


def descend(
    matcher: Matcher,
    pose: Pose,
    sources: tuple[Index, Index],
    radius: float,
    scale: float,
    offset: float,
    agreement: float,
    iterations: int,
) -> tuple[Pose, float, int]:
    """Gauss-Newton steps while the scale shrinks from ``scale`` to the noise; the pose, the scale, the steps made."""
    done = 0
    for done in range(1, iterations + 1):
        # a pair may lie as far apart as the clouds; later the scale tells how far
        reach = max(reach_of(matcher, scale), offset if done <= 8 else 0.0)
        pairs = matcher.match(pose, sources, reach, agreement)
        if len(pairs) < 12:
            break
        weight = tukey_weights(pairs.residual, scale)
        jacobian = pairs.jacobian(radius)
        normal = jacobian.T @ (jacobian * weight[:, None])
        normal += 1e-6 * max(float(np.trace(normal)), 1e-12) * np.eye(6)
        step: Float = -np.linalg.solve(normal, jacobian.T @ (weight * pairs.residual))
        pose = pose.moved(step, radius)
        smaller = max(robust_scale(pairs.residual), _NOISE_FLOOR, _SHRINK * scale)
        steady = abs(smaller - scale) < 0.02 * scale and np.linalg.norm(step) < max(0.1 * scale, 1e-4)
        scale = smaller
        if steady and done >= 3:
            break
    return pose, scale, done


def refine(
    matcher: Matcher, pose: Pose, scale: float, radius: float, offset: float, used: int, limit: int, progress: Progress
) -> Alignment:
    """Newton's steps with all points and with neighbourhoods that have changed left out as a whole."""
    reach = reach_of(matcher, scale)
    voxel = max(matcher.reference.spacing, matcher.moving.spacing)
    block = max(10 * voxel, TUKEY * scale)
    fold_block = max(min(block, radius / 8), 2 * voxel)

    def weigh(pairs: Pairs) -> Float:
        return tukey_weights(pairs.residual, scale) * regional_weights(pairs, scale, block)

    few = matcher.sample(_CURVATURE_SOURCES)
    evaluations = 0

    def evaluate(motion: Float) -> Estimate:
        nonlocal evaluations
        evaluations += 1
        progress.update(0.4 + 0.3 * evaluations / 12, "measuring what the surface fixes")
        pairs = matcher.match(pose.moved(motion, radius), few, reach)
        return estimate(pairs, weigh(pairs), radius, fold_block)

    folds = curvature_folds(evaluate, max(scale, voxel / 8))
    sources = matcher.sample(_ALL_SOURCES)
    pairs = matcher.match(pose, sources, reach)
    weight = weigh(pairs)

    def informed() -> Information:
        terms = pairs.jacobian(radius) * (weight * pairs.residual)[:, None]
        return information(folds, terms, block_numbers(pairs.place, fold_block), matcher_sd, offset / np.sqrt(3.0))

    matcher_sd = voxel / 2
    found = informed()
    if not found.observable.all():
        # what nothing fixes stays as surveyed
        pose = Pose.from_vector(found.without_unobservable(pose.vector(radius)), radius)
    converged = False
    for i in range(_NEWTON):
        if used >= limit and i > 0:
            break
        progress.update(0.7 + 0.25 * i / _NEWTON, "registering with all points")
        pairs = matcher.match(pose, sources, reach)
        weight = weigh(pairs)
        jacobian = pairs.jacobian(radius)
        step = found.step(jacobian.T @ (weight * pairs.residual), len(pairs))
        length = float(np.linalg.norm(step))
        if length > voxel / 2:
            step *= voxel / 2 / length
        pose = pose.moved(step, radius)
        used += 1
        # the pairs of the next step are other ones in part: below its own error a step is noise
        error = float(np.sqrt(np.trace(found.observable_covariance)))
        if length < max(2e-5, 0.05 * error):
            converged = True
            break
    return Alignment(pose, scale, radius, used, converged, informed(), pairs, weight)
