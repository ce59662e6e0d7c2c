"""Robust alignment of two surfaces from coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .observability import Estimate, Information, curvature_folds, estimate, information
from .point_to_plane import TUKEY, Matcher, Pairs, regional_weights, tukey_weights
from .pose import Pose
from .progress import Progress
from .restarts import Descent, descend, reach_of, reconsider
from .surface import Surface
from .voxel import block_numbers

Float = NDArray[np.float64]
Index = NDArray[np.int64]

_COARSE = 4.0  # voxels of one level in those of the next finer one
_COARSE_SOURCES, _SOURCES, _CURVATURE_SOURCES, _ALL_SOURCES = 6_000, 40_000, 30_000, 150_000
_LEAST_POINTS = 400  # of a coarse level
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
    best, remaining, reach = Descent(Pose.identity(), offset / 2, 0), iterations, offset
    known = reference if stable is None else reference[stable]
    for size in levels(voxel, offset)[:-1]:
        progress.update(0.1, f"registering at {size:g} m")
        coarse = Matcher(Surface(known, size), Surface(moving, size))
        if min(len(coarse.reference.points), len(coarse.moving.points)) < _LEAST_POINTS:
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


_LEAST_PAIRS = 12


def refine(
    matcher: Matcher, pose: Pose, scale: float, radius: float, offset: float, limit: int, progress: Progress
) -> Alignment:
    """Newton's steps with all points and with neighbourhoods that have changed left out as a whole."""
    reach = reach_of(matcher, scale)
    voxel = max(matcher.reference.spacing, matcher.moving.spacing)
    block = max(10 * voxel, TUKEY * scale)
    fold_block = max(min(block, radius / 8), 2 * voxel)

    if len(matcher.match(pose, matcher.sample(_CURVATURE_SOURCES), reach)) < _LEAST_PAIRS:
        raise InputError(
            "The epochs hardly share any surface to register by; check that both cover the same slope, or raise "
            "maximum_offset."
        )

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
    used = 0
    for i in range(min(_NEWTON, max(limit, 1))):
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
