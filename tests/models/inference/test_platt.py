"""Scale and shift: found again where they are known, and what they mean for probabilities."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit, softmax
from slopewatch.engine.core.errors import InputError
from slopewatch.models.inference.platt import fit_platt, platt


def drawn(scale: float, shift: float, count: int = 60_000) -> tuple[np.ndarray, np.ndarray]:
    """Log odds of two hazards, and classes drawn by the probabilities that scale and shift make of them."""
    rng = np.random.default_rng(3)
    odds = rng.normal(-1.5, 2.0, (count, 2))
    probabilities = softmax(np.column_stack([np.zeros(count), scale * odds + shift]), axis=1)
    return odds, (rng.random(count)[:, None] > probabilities.cumsum(axis=1)).sum(axis=1)


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 0.0), (0.4, -1.2), (1.7, 0.8)])
def test_known_scale_and_shift_are_found(scale, shift):
    odds, labels = drawn(scale, shift)
    assert fit_platt(odds, labels) == pytest.approx((scale, shift), abs=0.04)
    found = platt(odds, labels)
    assert found.nll_after <= found.nll_before
    assert found.shares == pytest.approx(np.bincount(labels) / len(labels))
    assert found.summary()["cells"] == len(labels)


def test_one_hazard_is_the_logistic_regression_of_platt():
    rng = np.random.default_rng(4)
    odds = rng.normal(0.0, 2.0, 2000)
    labels = (rng.random(2000) < expit(0.6 * odds - 0.5)).astype(int)
    scale, shift = fit_platt(odds, labels)
    # At the maximum the residuals are square to both columns of the design.
    residuals = labels - expit(scale * odds + shift)
    assert residuals.sum() == pytest.approx(0.0, abs=0.05)
    assert residuals @ odds == pytest.approx(0.0, abs=0.05)


def test_a_weight_counts_as_so_many_cells():
    odds, labels = drawn(0.8, 0.3, 300)
    times = np.random.default_rng(1).integers(1, 4, 300)
    repeated = fit_platt(np.repeat(odds, times, axis=0), np.repeat(labels, times))
    assert fit_platt(odds, labels, times) == pytest.approx(repeated, abs=1e-4)


def test_nothing_to_fit_on_is_refused_and_useless_odds_keep_a_scale_above_0():
    with pytest.raises(InputError, match="no held-out ground"):
        fit_platt(np.zeros((0, 2)), np.zeros(0, dtype=int))
    with pytest.raises(InputError, match="no two classes"):
        fit_platt(np.zeros((5, 2)), np.zeros(5, dtype=int))
    odds, labels = drawn(1.0, 0.0, 500)
    assert fit_platt(-odds, labels)[0] > 0
