"""The temperature against probabilities whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.models.inference.calibration import apply_temperature, fit_temperature, temperature_of


def softmax(logits):
    powers = np.exp(logits - logits.max(axis=1, keepdims=True))
    return powers / powers.sum(axis=1, keepdims=True)


def drawn(sharpened: float, points: int = 60_000, seed: int = 1):
    """Labels drawn from probabilities, and these probabilities made too sure (or unsure) by a factor of the logits."""
    rng = np.random.default_rng(seed)
    logits = rng.normal(0, 1.5, (points, 3))
    honest = softmax(logits)
    labels = (rng.random(points)[:, None] > honest.cumsum(axis=1)).sum(axis=1)
    return softmax(sharpened * logits), labels, honest


@pytest.mark.parametrize("sharpened", [0.4, 1.0, 3.0])
def test_what_was_made_too_sure_is_undone(sharpened):
    stated, labels, honest = drawn(sharpened)
    found = fit_temperature(stated, labels)
    assert found.temperature == pytest.approx(sharpened, rel=0.03)
    assert found.nll_after == pytest.approx(-np.log(honest[np.arange(len(labels)), labels]).mean(), rel=1e-3)
    assert found.nll_after <= found.nll_before + 1e-12
    assert found.error_after < 0.01
    assert found.points == len(labels)
    np.testing.assert_allclose(apply_temperature(stated, found.temperature), honest, atol=0.02)


def test_no_other_temperature_is_better():
    stated, labels, _ = drawn(2.0, 5000)
    found = fit_temperature(stated, labels)
    for other in (0.9 * found.temperature, 1.1 * found.temperature, 0.06, 15.0):
        scaled = apply_temperature(stated, other)
        assert -np.log(scaled[np.arange(len(labels)), labels]).mean() > found.nll_after


def test_labels_stay_and_probabilities_add_up():
    stated, *_ = drawn(1.0, 2000)
    stated[0] = (1.0, 0.0, 0.0)
    for temperature in (0.3, 4.0):
        scaled = apply_temperature(stated.astype(np.float32), temperature)
        np.testing.assert_allclose(scaled.sum(axis=1), 1.0, atol=1e-9)
        np.testing.assert_array_equal(scaled.argmax(axis=1), stated.argmax(axis=1))
        assert np.isfinite(scaled).all()


def test_the_temperature_of_a_description():
    assert temperature_of({}) == 1.0
    assert temperature_of({"metrics": {"calibration": None}}) == 1.0
    assert temperature_of({"metrics": {"calibration": {"temperature": 1.7}}}) == 1.7
    for wrong in (0, -1.0, "2", None, float("nan"), True):
        with pytest.raises(InputError, match="temperature"):
            temperature_of({"metrics": {"calibration": {"temperature": wrong}}})


def test_without_points_there_is_nothing_to_fit():
    with pytest.raises(InputError, match="held-out"):
        fit_temperature(np.zeros((0, 3)), np.zeros(0, dtype=np.uint8))
