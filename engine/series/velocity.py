"""Velocities of cells and of zones by weighted regression of their change on time, with errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr

from ..core.arrays import Float
from ..statistics.normal import Z95

_MIN_FIT_PROBABILITY = 0.05  # a model is refused where chance would fit it worse in fewer cases than this
_ONSET_COUNT = 200
TRENDS = ("steady", "accelerating", "decelerating", "irregular", "not known")


@dataclass(frozen=True)
class Line:
    """A line's ``slope`` with its propagated ``error``; ``misfit`` is chi-square."""

    slope: float
    error: float
    misfit: float


@dataclass(frozen=True)
class Velocity:
    """Velocity of a zone, metres a day, upwards positive.

    Attributes:
        error: standard error.
        low, high: 95 % interval.
        epochs: indices of the surveys that it comes from.
        onset: indices of the last survey before the motion and of the first one in it; None where it moved throughout.
        trend: one of ``TRENDS``, of the motion since the onset.
    """

    rate: float
    error: float
    low: float
    high: float
    epochs: tuple[int, ...]
    onset: tuple[int, int] | None
    trend: str

    @property
    def significant(self) -> bool:
        """Whether the interval leaves out zero."""
        return self.low > 0 or self.high < 0


def fit_line(days: Float, y: Float, variance: Float) -> Line:
    """Weighted least squares of y (n,) on days (n,), weights 1/variance (m²).

    The slope's error is s / sqrt(sum (t - mean)²) with each survey's own s: 1 / sqrt(sum w (t - mean)²).
    """
    weight = 1.0 / variance
    mean_t, mean_y = (float(np.average(v, weights=weight)) for v in (days, y))
    spread = float(np.sum(weight * (days - mean_t) ** 2))
    slope = float(np.sum(weight * (days - mean_t) * (y - mean_y))) / spread
    rest = y - mean_y - slope * (days - mean_t)
    return Line(slope, spread**-0.5, float(np.sum(weight * rest**2)))


def current_velocity(days: Float, change: Float, variance: Float) -> Line | None:
    """The line through the most surveys up to the last that it fits; None with fewer than two surveys.

    A steady motion has all of its surveys, one that gets faster or slower the last ones.
    """
    known = np.isfinite(change) & np.isfinite(variance) & (variance > 0)
    t, x, v = days[known], change[known], variance[known]
    for start in range(len(t) - 1):
        line = fit_line(t[start:], x[start:], v[start:])
        if _accepted(line.misfit, len(t) - start - 2):
            return line
    return None


def zone_velocity(days: Float, change: Float, variance: Float) -> Velocity | None:
    """Velocity of a zone since its onset; None with fewer than two surveys.

    The motion is rest until an onset and a straight line from there on: y = a + v max(0, t - onset), fitted by weighted
    least squares for each onset. The onset is not known, so the velocity is the mean over all of them, weighted by how
    well they fit (the posterior for flat priors of a and v; half of the onset's prior lies before the first survey,
    which is the plain regression line, the rest evenly between the first and the last survey but one). The interval is
    that of the mixture, so it holds what the unknown onset leaves open. All errors are widened by the square root of
    chi-square over its degrees of freedom where the surveys scatter more than their errors explain.

    Args:
        days: (n,) days of the surveys since the first.
        change: (n,) mean change of the zone against the first survey, metres; NaN where it was not measured.
        variance: (n,) each survey's own variance, m²: of the first survey, too, whose change is zero by definition.
    """
    known = np.flatnonzero(np.isfinite(change) & np.isfinite(variance) & (variance > 0))
    if len(known) < 2:
        return None
    t, y, v = days[known], change[known], variance[known]
    onsets, prior = np.array([t[0]]), np.array([1.0])
    if len(t) > 3:
        later = np.linspace(t[0], t[-2], _ONSET_COUNT + 1)[1:]
        onsets, prior = np.append(onsets, later), np.append([0.5], np.full(_ONSET_COUNT, 0.5 / _ONSET_COUNT))
    rate, error, misfit, volume = ramps(t, y, v, onsets)
    degrees = len(t) - (2 if len(onsets) == 1 else 3)
    widened = max(1.0, float(misfit.min()) / degrees) if degrees > 0 else 1.0
    error = error * widened**0.5
    weight = prior * volume * np.exp(-0.5 * (misfit - misfit.min()) / widened)
    weight /= weight.sum()
    mean = float(weight @ rate)
    low, high = (_quantile(rate, error, weight, share) for share in (0.025, 0.975))
    line, used, between = fit_line(t, y, v), 0, None
    if len(onsets) > 1 and not _accepted(line.misfit / widened, len(t) - 2):
        likely = onsets[1:][int(np.argmax(weight[1:]))]
        used = int(np.searchsorted(t, likely))
        between = int(known[used - 1]), int(known[used])
        line = fit_line(t[used:], y[used:], v[used:])
    return Velocity(
        rate=mean,
        error=float(np.sqrt(weight @ (error**2 + (rate - mean) ** 2))),
        low=low,
        high=high,
        epochs=tuple(int(k) for k in known[used:]),
        onset=between,
        trend=_trend(t[used:], y[used:], v[used:], line),
    )


def ramps(t: Float, y: Float, v: Float, onsets: Float) -> tuple[Float, Float, Float, Float]:
    """For each onset (m,): velocity, its error, chi-square, and the square root of the covariance's determinant."""
    x = np.maximum(t - onsets[:, None], 0.0)
    weight = 1.0 / v
    total = weight.sum()
    dx = x - (x @ weight / total)[:, None]
    dy = y - float(y @ weight) / total
    spread = dx**2 @ weight
    rate = (dx * dy) @ weight / spread
    misfit = (dy - rate[:, None] * dx) ** 2 @ weight
    return rate, spread**-0.5, misfit, (total * spread) ** -0.5


def _quantile(rate: Float, error: Float, weight: Float, share: float) -> float:
    """Of a mixture of normal distributions."""
    low, high = float(np.min(rate - 8 * error)), float(np.max(rate + 8 * error))
    for _ in range(60):
        middle = (low + high) / 2
        if float(weight @ ndtr((middle - rate) / error)) < share:
            low = middle
        else:
            high = middle
    return (low + high) / 2


def _accepted(misfit: float, degrees: int) -> bool:
    return degrees <= 0 or float(chdtrc(degrees, misfit)) >= _MIN_FIT_PROBABILITY


def _trend(t: Float, y: Float, v: Float, line: Line) -> str:
    """Whether the motion gets faster: the sign of a parabola's curvature, where it is significant."""
    if len(t) < 4:
        return "not known"
    scale = float(t[-1] - t[0])
    x = (t - t[0]) / scale
    design = np.column_stack([np.ones_like(x), x, x * x]) / np.sqrt(v)[:, None]
    covariance = np.linalg.inv(design.T @ design)
    fitted = covariance @ design.T @ (y / np.sqrt(v))
    rest = float(np.sum((y / np.sqrt(v) - design @ fitted) ** 2))
    widened = max(1.0, rest / (len(t) - 3)) ** 0.5
    if abs(fitted[2]) > Z95 * widened * covariance[2, 2] ** 0.5:
        return "accelerating" if fitted[2] * line.slope > 0 else "decelerating"
    return "steady" if _accepted(line.misfit, len(t) - 2) else "irregular"


@dataclass(frozen=True)
class CellVelocity:
    """``rate`` and its standard ``error``, metres a day (rows, columns), NaN where unknown; ``count`` of surveys."""

    rate: Float
    error: Float
    count: NDArray[np.int64]


def cell_velocity(days: Float, change: list[Float], variance: list[Float]) -> CellVelocity:
    """The line of ``fit_line`` in every cell, from the surveys that measured it.

    Args:
        days: (n,) days of the surveys since the first.
        change: n arrays (rows, columns), change against the first survey, metres; zero for the first.
        variance: n arrays, each survey's own variance, m². Cells where either is NaN are left out of the sum.

    The error is widened as in ``zone_velocity`` where more than two surveys scatter more than their errors explain.
    """
    shape = change[0].shape
    count = np.zeros(shape, dtype=np.int64)
    w, wt, wy, wtt, wty, wyy = (np.zeros(shape) for _ in range(6))
    for day, y, v in zip(days, change, variance, strict=True):
        known = np.isfinite(y) & (v > 0)
        weight = np.where(known, 1.0 / np.where(known, v, 1.0), 0.0)
        value = np.where(known, y, 0.0)
        count += known
        for total, term in (
            (w, weight),
            (wt, weight * day),
            (wy, weight * value),
            (wtt, weight * day**2),
            (wty, weight * day * value),
            (wyy, weight * value**2),
        ):
            total += term
    enough = count >= 2
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = wtt - wt**2 / w
        rate = (wty - wt * wy / w) / spread
        misfit = np.maximum(wyy - wy**2 / w - rate**2 * spread, 0.0) / np.maximum(count - 2, 1)
        error = np.sqrt(np.where(count > 2, np.maximum(misfit, 1.0), 1.0) / spread)
    return CellVelocity(np.where(enough, rate, np.nan), np.where(enough, error, np.nan), count)


def own_variances(errors: list[Float], shared: list[float], first: Float, other: list[Float]) -> list[Float]:
    """Each survey's own variance, from the errors of its differences to the first survey.

    The first survey's variance is in every difference. It is separated by the share that the sampling variances of
    the cells give it, so that a calibration of the differences' errors carries over.

    Args:
        errors: standard errors of the differences of the surveys 1 to n to the first, m.
        shared: registration errors of the surveys 1 to n, m; they belong to the later survey.
        first: sampling variance of the first survey's cells, m².
        other: sampling variances of the surveys 1 to n, m².

    Returns:
        n + 1 arrays, the first survey's first.
    """
    total, times = np.zeros(first.shape), np.zeros(first.shape)
    parts = []
    for error, registration, sampling in zip(errors, shared, other, strict=True):
        with np.errstate(invalid="ignore", divide="ignore"):
            part = np.maximum(error**2 - registration**2, 0.0) * first / (first + sampling)
        parts.append(part)
        known = np.isfinite(part)
        total += np.where(known, part, 0.0)
        times += known
    with np.errstate(invalid="ignore", divide="ignore"):
        own = total / times
    return [own, *(np.maximum(e**2 - p, 0.0) for e, p in zip(errors, parts, strict=True))]
