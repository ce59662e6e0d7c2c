"""Restarts of a registration whose residuals exceed the surfaces' own noise.

Where much of what fixes a position lies within ground that has moved, weights that shrink slowly can settle between
the old and the new place. Registering with one part of the surface after the other, and without it, avoids that;
the fit with the smallest scale is best (the idea of the S-estimator, Rousseeuw and Yohai 1984).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Bool, Float, Index
from ..core.progress import Progress
from ..geometry.pose import Pose
from ..statistics.robust import robust_scale
from .point_to_plane import Matcher, Pairs, tukey_weights
from .surface import NOISE_FLOOR

MIN_PAIRS = 12
_MIN_SHRINK_FACTOR = 0.3  # smallest factor of the scale from one iteration to the next
_MAX_NOISE_RATIO = 1.5  # times the surfaces' own noise: above, other starts are tried
_REGION_COUNT, _REGION_SHARE = 12, 0.3
_SOURCES = 5_000
_PART_ITERATIONS, _WHOLE_ITERATIONS = 10, 8  # iterations with a part of the surface and with all of it again


@dataclass(frozen=True)
class Descent:
    """Where Gauss-Newton steps ended: ``scale`` (m) of the residuals, ``share`` of the sources that have a pair."""

    pose: Pose
    scale: float
    iterations: int = 0
    share: float = 0.0


@dataclass(frozen=True)
class Limits:
    """Bounds of one descent.

    Attributes:
        iterations: at most.
        offset: how far apart the surfaces may still be, metres.
        agreement: least cosine between paired normals.
        noise: least scale, metres.
        shrink: smallest factor of the scale from one iteration to the next.
    """

    iterations: int
    offset: float = 0.0
    agreement: float = 0.8
    noise: float = NOISE_FLOOR
    shrink: float = _MIN_SHRINK_FACTOR


def descend(
    matcher: Matcher,
    start: Descent,
    sources: tuple[Index, Index],
    limits: Limits,
    *,
    among: Callable[[Pairs], Bool] | None = None,
    free: Float | None = None,
) -> Descent:
    """Gauss-Newton steps from a pose, while the scale shrinks from that of the ``start`` to that of the residuals.

    Args:
        among: which pairs to use; all without it.
        free: (6, k) directions in which to move, columns of unit length at right angles; all without it.
    """
    pose, scale = start.pose, start.scale
    axes = np.eye(6) if free is None else free
    done, share = 0, 0.0
    for done in range(1, limits.iterations + 1):
        # a pair may lie as far apart as the clouds; later the scale limits the distance
        reach = max(matcher.reach(scale), limits.offset if done <= 8 else 0.0)
        pairs = matcher.match(pose, sources, reach, limits.agreement)
        share = len(pairs) / (len(sources[0]) + len(sources[1]))
        if among is not None and len(pairs):
            pairs = pairs.chosen(among(pairs))
        if len(pairs) < MIN_PAIRS:
            break
        weight = tukey_weights(pairs.residual, scale)
        jacobian = pairs.jacobian(matcher.radius)
        jacobian = jacobian if free is None else jacobian @ free
        normal = jacobian.T @ (jacobian * weight[:, None])
        normal += 1e-6 * max(float(np.trace(normal)), 1e-12) * np.eye(axes.shape[1])
        step = np.asarray(-np.linalg.solve(normal, jacobian.T @ (weight * pairs.residual)), dtype=np.float64)
        step = axes @ step
        pose = pose.moved(step, matcher.radius)
        smaller = max(robust_scale(pairs.residual), limits.noise, limits.shrink * scale)
        steady = abs(smaller - scale) < 0.02 * scale and np.linalg.norm(step) < max(0.1 * scale, 1e-4)
        scale = smaller
        if steady and done >= 3:
            break
    return Descent(pose, scale, done, share)


def reconsider(matcher: Matcher, first: Descent, sources: tuple[Index, Index], progress: Progress) -> Descent:
    """``first``, or what a search with parts of the surface found if its residuals are clearly smaller."""
    noise = matcher.noise
    if first.scale <= _MAX_NOISE_RATIO * noise:
        return first
    few = matcher.sample(_SOURCES)
    part, whole = (
        Limits(iterations, 4 * first.scale, noise=noise, shrink=shrink)
        for iterations, shrink in ((_PART_ITERATIONS, 0.6), (_WHOLE_ITERATIONS, 0.3))
    )
    best = first
    for number, centre in enumerate(_spread(matcher.reference.points[few[0]], _REGION_COUNT)):
        progress.update(0.3 + 0.1 * number / _REGION_COUNT, "registering with parts of the surface")
        for region in (_Region(centre, inside=False), _Region(centre, inside=True)):
            start = descend(matcher, Descent(first.pose, 2 * first.scale), few, part, among=region)
            start = descend(matcher, start, few, whole)
            # a pose that takes the surfaces apart pairs little of them, and that little well
            if start.scale < 0.9 * best.scale and start.share > 0.5 * first.share:
                best = start
    if best is first:
        return first
    found = descend(matcher, replace(best, scale=2 * best.scale), sources, Limits(20, noise=noise))
    if found.scale >= 0.9 * first.scale:
        return first
    return replace(found, iterations=first.iterations + found.iterations)


@dataclass(frozen=True)
class _Region:
    """The share of the pairs nearest to a centre, or all others."""

    centre: Float
    inside: bool

    def __call__(self, pairs: Pairs) -> Bool:
        distance = np.sum((pairs.place - self.centre) ** 2, axis=1)
        near: Bool = distance <= np.quantile(distance, _REGION_SHARE)
        return near if self.inside else ~near


def _spread(points: Float, count: int) -> Float:
    """``count`` of the points, each as far as can be from those before (farthest-point sampling)."""
    chosen = [int(np.argmax(np.sum((points - points.mean(axis=0)) ** 2, axis=1)))]
    distance = np.sum((points - points[chosen[0]]) ** 2, axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.sum((points - points[chosen[-1]]) ** 2, axis=1))
    return points[chosen]
