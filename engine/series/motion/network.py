"""Places of ground through time from its motion between pairs of surveys: least squares with the full covariance.

Motion is measured from the first survey to each and from each to the next, so that most surveys take part in three
pairs. The error of a pair has three parts. The noise of a survey's points is in all of its pairs; the product of the
noises of both surveys, which outweighs it where relief is faint, is in that pair alone; and the error of a survey's
registration moves it against all others. The second part is what a triangle of pairs fails to close by. The places are
adjusted as a network (as in levelling) with the covariance that these parts make.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.optimize import nnls

from ...core.arrays import Bool, Float, Index
from ...displacement.vectors import squared_length

AXES = 3
"""Along the dip, across it and along the normal."""
_MEDIAN_CHI2 = (1.3863, 0.4549)  # of two degrees of freedom, and of one
_MIN_CLOSURES = 20  # of triangles; with fewer their scatter says too little
_UNKNOWN_SHARE, _MIN_SHARE = 0.5, 0.05
_MIN_WEIGHT_SHARE = 0.05  # of the surveys' mean noise: no survey is without
_MAX_BATCH_VALUES = 2_000_000  # of the pairs' covariances that are held at a time


@dataclass(frozen=True)
class Links:
    """The ``pairs`` (earlier, later) of ``surveys`` surveys between which motion is measured."""

    surveys: int
    pairs: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, surveys: int) -> Links:
        """From the first survey to each other one, then from each but the first to the next."""
        steps = [pair for pair in pairwise(range(surveys)) if pair[0] > 0]
        return cls(surveys, (*((0, k) for k in range(1, surveys)), *steps))

    @cached_property
    def incidence(self) -> Float:
        """(pairs, surveys): -1 where a pair begins, 1 where it ends."""
        found = np.zeros((len(self.pairs), self.surveys))
        for row, (earlier, later) in enumerate(self.pairs):
            found[row, earlier], found[row, later] = -1.0, 1.0
        return found

    def until(self, survey: int) -> Bool:
        """(pairs,) which pairs are of surveys up to that one."""
        return np.array([later <= survey for _, later in self.pairs])


@dataclass(frozen=True)
class Noise:
    """How the errors of pairs are made up, registration aside.

    ``own`` (3,) is the share of a pair's variance that is in that pair alone, by axis; ``weights`` (surveys,) say how
    much of the rest each survey brings.
    """

    own: Float
    weights: Float

    def correlation(self, links: Links) -> Float:
        """(3, pairs, pairs) of the pairs' errors, by axis."""
        shared = links.incidence @ np.diag(self.weights) @ links.incidence.T
        root = np.sqrt(np.diag(shared))
        shared = shared / np.outer(root, root)
        return np.stack([share * np.eye(len(shared)) + (1 - share) * shared for share in self.own])


@dataclass(frozen=True)
class Measured:
    """Motion of n places between the pairs of ``links``, in the frames of the places.

    Attributes:
        motion: (pairs, n, 3) metres; NaN where not measured.
        covariance: (pairs, n, 3, 3) without the registrations' errors, m².
        registration: (n, surveys, 3, 3) of each survey against the first one, m²; zero for that.
    """

    links: Links
    motion: Float
    covariance: Float
    registration: Float

    @cached_property
    def known(self) -> Bool:
        """(pairs, n) what was measured."""
        return np.asarray(np.isfinite(self.motion).all(axis=2) & np.isfinite(self.covariance).all(axis=(2, 3)))

    def part(self, places: Index) -> Measured:
        """Some of the places."""
        return Measured(
            self.links, self.motion[:, places], self.covariance[:, places], self.registration[places]
        )  # fmt: skip


@dataclass(frozen=True)
class Adjusted:
    """n places through the surveys, in their frames; NaN where not known.

    Attributes:
        motion: (n, surveys, 3) against the first survey, metres; zero for that.
        covariance: (n, surveys, 3, surveys, 3) of it, m²; zero for the first survey.
        velocity: (n, 3) metres a day: the straight line through time that fits best.
        velocity_covariance: (n, 3, 3) of it, wider where the surveys scatter more than their errors explain.
        scatter: (n,) by how much the squared deviations of the surveys before the last from their line exceed what is
            stated; at least 1.
    """

    motion: Float
    covariance: Float
    velocity: Float
    velocity_covariance: Float
    scatter: Float


def noise_of(measured: Measured) -> Noise:
    """The noise of pairs, from the triangles that the first survey makes with two that follow each other."""
    links, known = measured.links, measured.known
    number = {pair: row for row, pair in enumerate(links.pairs)}
    along, normal = [], []
    for k in range(2, links.surveys):
        rows = [number[0, k - 1], number[k - 1, k], number[0, k]]
        use = known[rows].all(axis=0)
        before, step, whole = (measured.motion[row][use] for row in rows)
        gap, variance = before + step - whole, measured.covariance[rows][:, use].sum(axis=0)
        along.append(squared_length(gap[:, :2], variance[:, :2, :2]))
        normal.append(gap[:, 2] ** 2 / variance[:, 2, 2])
    shares = [_share(found, middle) for found, middle in zip((along, normal), _MEDIAN_CHI2, strict=True)]
    return Noise(np.array([shares[0], shares[0], shares[1]]), _weights(measured))


def _share(found: list[Float], middle: float) -> float:
    values = np.concatenate(found) if found else np.zeros(0)
    if len(values) < _MIN_CLOSURES:
        return _UNKNOWN_SHARE
    return float(np.clip(np.median(values) / middle, _MIN_SHARE, 1.0))


def _weights(measured: Measured) -> Float:
    """(surveys,) such that the sum of a pair's is near its median variance along the surface."""
    links, known = measured.links, measured.known
    rows = np.flatnonzero(known.any(axis=1))
    if not len(rows):
        return np.ones(links.surveys)
    size = np.array([np.median(np.trace(measured.covariance[r, known[r], :2, :2], axis1=1, axis2=2)) for r in rows])
    found = np.asarray(nnls(np.abs(links.incidence[rows]) / size[:, None], np.ones(len(rows)))[0])
    taking_part = np.abs(links.incidence[rows]).any(axis=0)
    mean = float(found[taking_part].mean())
    return np.asarray(np.where(taking_part, np.maximum(found, _MIN_WEIGHT_SHARE * mean), mean))


def batches(measured: Measured) -> list[Index]:
    """Numbers of the places in groups whose covariances fit in memory."""
    count = measured.motion.shape[1]
    each = max(1, _MAX_BATCH_VALUES // (AXES * len(measured.links.pairs)) ** 2)
    return [np.arange(start, min(start + each, count)) for start in range(0, count, each)]


def adjust(measured: Measured, noise: Noise, days: Float, last: int | None = None) -> Adjusted:
    """The places by generalised least squares from all pairs up to the survey ``last`` (else the last one).

    Args:
        days: (surveys,) since the first survey.
    """
    links = measured.links
    last = links.surveys - 1 if last is None else last
    count = measured.motion.shape[1]
    correlation = noise.correlation(links)
    result = Adjusted(
        np.full((count, links.surveys, AXES), np.nan),
        np.full((count, links.surveys, AXES, links.surveys, AXES), np.nan),
        np.full((count, AXES), np.nan),
        np.full((count, AXES, AXES), np.nan),
        np.ones(count),
    )
    result.motion[:, 0] = 0.0
    result.covariance[:, 0] = result.covariance[:, :, :, 0] = 0.0
    usable = measured.known & links.until(last)[:, None]
    patterns, which = np.unique(usable.T, axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        surveys = _reached(links, pattern)
        rows = np.flatnonzero(pattern & np.isin(np.array(links.pairs)[:, 1], surveys))
        if len(surveys):
            places = np.flatnonzero(which.reshape(-1) == number)
            _solve(measured, places, rows, surveys, correlation, days, result)
    return result


def _reached(links: Links, pattern: Bool) -> Index:
    """The surveys, the first aside, that pairs of ``pattern`` join to the first."""
    reached = {0}
    for _ in range(links.surveys):
        for (earlier, later), there in zip(links.pairs, pattern, strict=True):
            if there and (earlier in reached or later in reached):
                reached |= {earlier, later}
    return np.array(sorted(reached - {0}), dtype=np.int64)


def _solve(
    measured: Measured, places: Index, rows: Index, surveys: Index, correlation: Float, days: Float, result: Adjusted
) -> None:
    """Fill in the places, which have the same pairs (``rows``) and so the same ``surveys``."""
    pairs, known = len(rows), len(surveys)
    root = np.linalg.cholesky(np.moveaxis(measured.covariance[rows][:, places], 0, 1))
    parts = correlation[:, rows][:, :, rows]
    full = np.einsum("gmab,bmn,gncb->gmanc", root, parts, root, optimize=True)
    incidence = measured.links.incidence[rows]
    full += np.einsum("mk,nk,gkac->gmanc", incidence, incidence, measured.registration[places], optimize=True)
    inverse = np.linalg.inv(full.reshape(-1, AXES * pairs, AXES * pairs))
    design = np.kron(incidence[:, surveys], np.eye(AXES))
    motion = np.moveaxis(measured.motion[rows][:, places], 0, 1).reshape(-1, AXES * pairs)
    normal = design.T @ inverse @ design
    covariance = np.linalg.inv(normal)
    found = np.einsum("gij,gj->gi", covariance, np.einsum("gij,gj->gi", design.T @ inverse, motion))
    result.motion[places[:, None], surveys[None, :]] = found.reshape(-1, known, AXES)
    shaped = covariance.reshape(-1, known, AXES, known, AXES)
    for i, survey in enumerate(surveys):
        for j, other in enumerate(surveys):
            result.covariance[places, survey, :, other] = shaped[:, i, :, j]
    slope, slope_covariance, misfit = _line(days[surveys], found, normal)
    result.velocity[places] = slope
    result.velocity_covariance[places] = slope_covariance * misfit[:, None, None]
    if known > 2:
        before = AXES * (known - 1)
        inverse = np.linalg.inv(covariance[:, :before, :before])
        result.scatter[places] = _line(days[surveys[:-1]], found[:, :before], inverse)[2]


def _line(days: Float, motion: Float, inverse: Float) -> tuple[Float, Float, Float]:
    """Slope (n, 3) of motions (n, 3 surveys) on days, its covariance, and their reduced misfit, at least 1.

    Args:
        inverse: (n, 3 surveys, 3 surveys) of the motions' covariance.
    """
    line = np.kron(days[:, None], np.eye(AXES))
    covariance = np.linalg.inv(line.T @ inverse @ line)
    slope = np.einsum("gij,gj->gi", covariance, np.einsum("gij,gj->gi", line.T @ inverse, motion))
    rest = motion - slope @ line.T
    misfit = np.einsum("gi,gij,gj->g", rest, inverse, rest) / max(AXES * (len(days) - 1), 1)
    return slope, covariance, np.maximum(misfit, 1.0)


def own_variances(covariance: Float) -> Float:
    """(surveys,) variances of which the sum of any two comes nearest to that of the difference of these surveys.

    Args:
        covariance: (surveys, surveys) of motions in one direction against the first survey, whose row is zero.
    """
    count = len(covariance)
    first, other = np.triu_indices(count, 1)
    variance = np.diag(covariance)
    difference = variance[first] + variance[other] - 2 * covariance[first, other]
    design = np.zeros((len(first), count))
    design[np.arange(len(first)), first] = design[np.arange(len(first)), other] = 1.0
    scale = float(difference.mean()) if len(difference) and difference.mean() > 0 else 1.0
    found = np.asarray(nnls(design, difference / scale)[0]) * scale
    return np.asarray(np.maximum(found, 1e-3 * scale))
