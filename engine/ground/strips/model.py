"""Offsets and slow drift of strips, by weighted least squares over the cells where they overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Index
from ...statistics.robust import nmad
from .overlaps import Overlaps

_EXPECTED_OFFSET_M = 0.3
"""Of a strip against the others; far beyond what is found, it only keeps what no overlap fixes at rest."""
_EXPECTED_SHIFT_M = 0.3
_EXPECTED_DRIFT_M = 0.02
"""Along a strip. What two strips that overlap along their whole length have in common is hardly fixed by them: it
stays small by this."""
_TUKEY = 4.685
_MAX_ROUNDS = 12
DRIFT_TERMS = 2
"""A straight line and a parabola over the time of each strip."""
LEVELS = ("height", "position", "drift")


@dataclass(frozen=True)
class StripTimes:
    """Middle and half length (k,) of the time in which each strip was flown, s."""

    middle: Float
    half: Float

    def terms(self, strip: Index, seconds: Float) -> Float:
        """(n, DRIFT_TERMS) Legendre polynomials of the time within the strip."""
        within = np.clip((seconds - self.middle[strip]) / self.half[strip], -1.0, 1.0)
        return np.column_stack([within, 1.5 * within**2 - 0.5])


@dataclass(frozen=True)
class StripModel:
    """What is taken off each strip: ``shift`` (k, 3) in x, y and z, and ``drift`` (k, DRIFT_TERMS) of heights, m.

    ``error`` (k, 3): standard errors of the shift against the others, from the noise of the cells alone.
    """

    shift: Float
    drift: Float
    error: Float
    times: StripTimes

    def correction(self, strip: Index, seconds: Float) -> Float:
        """(n, 3) that is subtracted from points of ``strip`` (n,) measured at ``seconds`` (n,)."""
        taken = self.shift[strip]
        taken[:, 2] += (self.drift[strip] * self.times.terms(strip, seconds)).sum(axis=1)
        return taken

    def heights(self, pairs: Overlaps) -> Float:
        """(n, 2) by how much the model lowers the ground of each strip of the pairs in place, m."""

        def height(strip: Index, seconds: Float) -> Float:
            moved = self.correction(strip, seconds)
            # Ground that was shifted by s shows its height at another place: h(x - s) = h(x) - s grad h.
            return np.asarray(moved[:, 2] - (moved[:, :2] * pairs.gradient).sum(axis=1))

        return np.column_stack([height(pairs.first, pairs.seconds[:, 0]), height(pairs.second, pairs.seconds[:, 1])])

    def differences(self, pairs: Overlaps) -> Float:
        """(n,) height differences that the model explains."""
        heights = self.heights(pairs)
        return np.asarray(heights[:, 0] - heights[:, 1])


def fitted(pairs: Overlaps, level: str, points: Float, times: StripTimes) -> StripModel:
    """The model of ``level`` (of LEVELS, each with all before it) that takes most of the differences away.

    The mean of all strips by their ``points`` (k,) stays where it is: where the survey as a whole lies is left to
    registration.
    """
    strips, terms = len(points), 1 + 2 * (level != "height") + DRIFT_TERMS * (level == "drift")
    design = _design(pairs, strips, level, times)
    expected = np.array([_EXPECTED_OFFSET_M, *[_EXPECTED_SHIFT_M] * 2, *[_EXPECTED_DRIFT_M] * DRIFT_TERMS])[:terms]
    prior = np.diag(np.repeat(expected**-2.0, strips))
    solution = np.zeros(design.shape[1])
    extra, weight = 0.0, np.ones(len(pairs))
    for _ in range(_MAX_ROUNDS):
        left = pairs.height - design @ solution
        # Relief that both strips sampled unevenly, and plants, add to the noise of the cells.
        extra = max(nmad(left, 0.0) ** 2 - float(np.median(pairs.variance)), 0.0)
        sd = np.sqrt(pairs.variance + extra)
        weight = np.clip(1.0 - (left / (_TUKEY * sd)) ** 2, 0.0, 1.0) ** 2 / sd**2
        normal = design.T @ (design * weight[:, None]) + prior
        previous, solution = solution, np.linalg.solve(normal, design.T @ (weight * pairs.height))
        if np.abs(solution - previous).max() < 1e-5:
            break
    covariance = np.linalg.inv(design.T @ (design * weight[:, None]) + prior)
    share = points / points.sum()
    values = solution.reshape(terms, strips)
    values[: min(terms, 3)] -= (values[: min(terms, 3)] * share).sum(axis=1, keepdims=True)
    centring = np.eye(strips) - share[None, :]
    shift, error = np.zeros((strips, 3)), np.zeros((strips, 3))
    for row, axis in enumerate((2, 0, 1)[: min(terms, 3)]):
        block = covariance[row * strips : (row + 1) * strips, row * strips : (row + 1) * strips]
        shift[:, axis] = values[row]
        error[:, axis] = np.sqrt(np.diag(centring @ block @ centring.T))
    drift = values[3:].T if terms > 3 else np.zeros((strips, DRIFT_TERMS))
    return StripModel(shift, np.ascontiguousarray(drift), error, times)


def _design(pairs: Overlaps, strips: int, level: str, times: StripTimes) -> Float:
    """(n, terms * strips): heights, then x and y, then the drift's terms, each by strip."""

    def block(first: Float, second: Float) -> Float:
        columns = np.zeros((len(pairs), strips))
        rows = np.arange(len(pairs))
        columns[rows, pairs.first] += first
        columns[rows, pairs.second] -= second
        return columns

    one = np.ones(len(pairs))
    blocks = [block(one, one)]
    if level != "height":
        blocks += [block(-pairs.gradient[:, axis], -pairs.gradient[:, axis]) for axis in (0, 1)]
    if level == "drift":
        of_first = times.terms(pairs.first, pairs.seconds[:, 0])
        of_second = times.terms(pairs.second, pairs.seconds[:, 1])
        blocks += [block(of_first[:, k], of_second[:, k]) for k in range(DRIFT_TERMS)]
    return np.concatenate(blocks, axis=1)
