"""Probabilities from scores: Platt scaling of a network's log odds of a hazard, each survey left out in turn.

Platt 1999, Probabilistic outputs for support vector machines: 1 / (1 + exp(-(scale * score + shift))), by maximum
likelihood. The cells of the scenes with hazards are weighted so that hazards cover ``HAZARD_SHARE`` of the ground of
each survey, and all surveys count alike. Fitted on clouds and simulated slopes; elevation models get what these give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from ...engine.core.arrays import Float, Float32
from ...models.inference.calibration_bins import calibration_error
from .screening_ground import ELEVATION
from .screening_trials import PlaceResult

HAZARD_SHARE = 0.03
"""Of the ground that hazards are taken to cover."""
BINS = 10
SCORES = np.arange(-40.0, 40.0, 0.02) + 0.01
"""Middles of the classes into which scores are counted; what lies beyond belongs to the outermost."""
_STEEPEST = 50.0
_AS_CELLS = 1e6


@dataclass(frozen=True)
class Platt:
    """Probability 1 / (1 + exp(-(``scale`` * score + ``shift``)))."""

    scale: float
    shift: float

    def __call__(self, scores: Float) -> Float:
        return np.asarray(expit(self.scale * scores + self.shift))


@dataclass(frozen=True)
class KindCalibration:
    """Expected calibration error on places of a kind, of the odds as they are and after scaling fitted on others."""

    kind: str
    before: float
    after: float


def fit_platt(scores: Float, positive: Float, negative: Float) -> Platt:
    """Scale and shift with the highest likelihood.

    Args:
        scores: (n,). positive, negative: (n,) weights of what is one and of what is none at each score.
    """
    total = positive + negative
    middle = float(np.average(scores, weights=total))
    spread = max(float(np.sqrt(np.average((scores - middle) ** 2, weights=total))), 1e-9)
    level = (scores - middle) / spread
    weight = float(total.sum())

    def loss(values: Float) -> tuple[float, Float]:
        odds = values[0] * level + values[1]
        value = (np.logaddexp(0.0, odds) * total - positive * odds).sum() / weight
        slope = (expit(odds) * total - positive) / weight
        return float(value), np.array([slope @ level, slope.sum()])

    bounds = [(-_STEEPEST, _STEEPEST)] * 2
    options = {"ftol": 1e-14, "gtol": 1e-10, "maxiter": 500}
    found = minimize(loss, np.array([1.0, 0.0]), jac=True, method="L-BFGS-B", bounds=bounds, options=options).x
    return Platt(float(found[0]) / spread, float(found[1] - found[0] * middle / spread))


def hazard_odds(both: Float32) -> Float:
    """Log odds of a hazard of either sign from those (2, n) of uplift and of subsidence."""
    sure = np.logaddexp(*(-np.logaddexp(0.0, -one.astype(np.float64)) for one in both))
    return np.asarray(sure - np.log(np.maximum(-np.expm1(np.minimum(sure, -1e-12)), 1e-12)))


def counted(result: PlaceResult, answers: Float32, *, odds: bool) -> Float:
    """(2, scores) cells of the scenes without and with a hazard whose score is in each class of ``SCORES``.

    Args:
        odds: whether the scores are log odds of the signs, which are added up; else the larger counts.
    """
    step = SCORES[1] - SCORES[0]
    total = np.zeros((2, len(SCORES)))
    for scene, both in enumerate(answers[1:]):
        truth = np.zeros(result.lattice.shape, dtype=bool)
        for one in result.trials:
            if one.scene == scene and not one.empty:
                truth.ravel()[one.cells] = True
        known = np.isfinite(both).all(axis=0)
        score = hazard_odds(both[:, known]) if odds else both[:, known].max(axis=0)
        number = np.clip(np.rint((score - SCORES[0]) / step), 0, len(SCORES) - 1).astype(np.int64)
        for k, mine in enumerate((~truth[known], truth[known])):
            total[k] += np.bincount(number[mine], minlength=len(SCORES))
    return total


def calibrate(results: Sequence[PlaceResult], counts: Sequence[Float]) -> tuple[list[KindCalibration], Platt]:
    """Expected calibration error by kind, each survey by the fit of the others, and the fit of all.

    Args:
        counts: of ``counted``, at each place.
    """
    weighted: dict[str, list[Float]] = {}
    kind = {}
    for one, cells in zip(results, counts, strict=True):
        if cells.sum(axis=1).all():
            share = np.array([[1.0 - HAZARD_SHARE], [HAZARD_SHARE]]) / cells.sum(axis=1, keepdims=True)
            weighted.setdefault(one.place.group, []).append(cells * share)
            kind[one.place.group] = one.place.kind
    surveys = {group: np.mean(values, axis=0) for group, values in weighted.items()}
    fitted = {group: values for group, values in surveys.items() if kind[group] != ELEVATION} or surveys

    def fit(left_out: str | None) -> Platt:
        used = [values for group, values in fitted.items() if group != left_out] or list(fitted.values())
        none, some = np.sum(used, axis=0)
        return fit_platt(SCORES, some, none)

    found = []
    for name in dict.fromkeys(kind.values()):
        groups = [group for group in surveys if kind[group] == name]
        errors = [
            calibration_error(sum(_bins(scaled(group), surveys[group]) for group in groups) * _AS_CELLS)  # type: ignore[arg-type]
            for scaled in (lambda _: expit(SCORES), lambda group: fit(group)(SCORES))
        ]
        found.append(KindCalibration(name, *errors))
    return found, fit(None)


def _bins(probability: Float, cells: Float) -> Float:
    """(BINS, 3) weight, sum of stated probability and weight of hazards in equal bins of the probability."""
    index = np.minimum((probability * BINS).astype(np.int64), BINS - 1)
    total = cells.sum(axis=0)
    columns = (total, total * probability, cells[1])
    return np.stack([np.bincount(index, weights=values, minlength=BINS) for values in columns], axis=1)
