"""Platt's scale and shift: two numbers that make log odds as sure as they are right.

Platt 1999, Probabilistic outputs for support vector machines, for several hazards against one background: the log odds
of each become scale * log odds + shift. Unlike one temperature this also moves the odds of hazards as a whole, as they
are on ground where hazards are rarer than where the network learnt.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import logsumexp

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError

SCALES, SHIFTS = (0.02, 20.0), (-15.0, 15.0)
"""Between which scale and shift are looked for; 1 and 0 change nothing."""


@dataclass(frozen=True)
class Platt:
    """A fitted ``scale`` and ``shift``, with the mean negative log-likelihood before and after them on the ``cells`` of
    the fit, and the share of each class among these, by weight.
    """

    scale: float
    shift: float
    nll_before: float
    nll_after: float
    cells: int
    shares: tuple[float, ...]

    def summary(self) -> dict[str, Any]:
        """By name, rounded, ready for JSON."""
        found = {name: round(value, 5) if isinstance(value, float) else value for name, value in asdict(self).items()}
        return found | {"shares": [round(share, 5) for share in self.shares]}


def fit_platt(
    log_odds: NDArray[np.floating], labels: NDArray[np.integer], weights: NDArray[np.floating] | None = None
) -> tuple[float, float]:
    """Scale and shift of the greatest likelihood, by L-BFGS-B on the mean negative log-likelihood, which is convex.

    Args:
        log_odds: (n, k) of each of k hazards against the background; (n,) for one.
        labels: (n,) 0 background, 1 to k the hazards. weights: (n,) what each counts; 1 by default.

    Raises:
        InputError: there is nothing to fit on, or only one class.
    """
    odds, known, share = _given(log_odds, labels, weights)
    if len(np.unique(known[share > 0])) < 2:
        raise InputError("There are no two classes on held-out ground to calibrate with; give more labelled files.")

    def loss(values: Float) -> tuple[float, Float]:
        return _loss(values[0], values[1], odds, known, share)

    found = minimize(loss, np.array([1.0, 0.0]), jac=True, method="L-BFGS-B", bounds=[SCALES, SHIFTS], tol=1e-12)
    return float(found.x[0]), float(found.x[1])


def platt(
    log_odds: NDArray[np.floating], labels: NDArray[np.integer], weights: NDArray[np.floating] | None = None
) -> Platt:
    """As ``fit_platt``, with what the fit gains."""
    scale, shift = fit_platt(log_odds, labels, weights)
    odds, known, share = _given(log_odds, labels, weights)
    shares = np.bincount(known, share, odds.shape[1] + 1)
    before, after = (_loss(a, b, odds, known, share)[0] for a, b in ((1.0, 0.0), (scale, shift)))
    return Platt(scale, shift, before, after, len(known), tuple(float(one) for one in shares))


def _given(
    log_odds: NDArray[np.floating], labels: NDArray[np.integer], weights: NDArray[np.floating] | None
) -> tuple[Float, NDArray[np.int64], Float]:
    if not len(labels):
        raise InputError("There is no held-out ground to calibrate on; give more labelled files.")
    odds = np.asarray(log_odds, dtype=np.float64).reshape(len(labels), -1)
    share = np.ones(len(labels)) if weights is None else np.asarray(weights, dtype=np.float64)
    return odds, np.asarray(labels, dtype=np.int64), share / share.sum()


def _loss(scale: float, shift: float, odds: Float, labels: NDArray[np.int64], share: Float) -> tuple[float, Float]:
    """Mean negative log-likelihood and its slopes along scale and shift."""
    scaled = np.concatenate([np.zeros((len(odds), 1)), scale * odds + shift], axis=1)
    total = logsumexp(scaled, axis=1)
    own = np.arange(len(labels))
    probabilities = np.exp(scaled[:, 1:] - total[:, None])
    hazard = labels > 0
    of_label = np.where(hazard, odds[own, np.maximum(labels - 1, 0)], 0.0)
    slopes = ((probabilities * odds).sum(axis=1) - of_label, probabilities.sum(axis=1) - hazard)
    return float(share @ (total - scaled[own, labels])), np.array([share @ slope for slope in slopes])
