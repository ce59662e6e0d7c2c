"""Losses by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

UNKNOWN = 255


@pytest.fixture
def loss(torch):
    from slopewatch.models.training import loss

    return loss


def test_published_weights_are_inverse_frequencies_with_a_limit(loss, torch):
    weights = loss.published_weights(torch.tensor([0.9, 0.08, 0.02]), eps=0.02, w_max=15.0)
    np.testing.assert_allclose(weights, [1 / 0.92, 10.0, 15.0], rtol=1e-6)


def test_root_weights_have_a_mean_of_one(loss, torch):
    frequencies = torch.tensor([0.64, 0.32, 0.04])
    weights = loss.root_inverse_weights(frequencies, eps=0.0)
    assert float((weights * frequencies).sum()) == pytest.approx(1.0)
    assert float(weights[2] / weights[0]) == pytest.approx(4.0)


def test_cross_entropy_by_hand(loss, torch):
    logits = torch.log(torch.tensor([[0.7, 0.2, 0.1], [0.1, 0.6, 0.3], [0.2, 0.2, 0.6]]))
    labels = torch.tensor([0, 2, UNKNOWN])
    value = loss.cross_entropy(logits, labels, torch.tensor([1.0, 1.0, 3.0]))
    assert float(value) == pytest.approx((-math.log(0.7) - 3 * math.log(0.3)) / 4, rel=1e-5)
    assert float(loss.cross_entropy(logits, torch.full((3,), UNKNOWN), torch.ones(3))) == 0.0


def test_dice_by_hand(loss, torch):
    logits = torch.log(torch.tensor([[0.8, 0.1, 0.1], [0.3, 0.6, 0.1], [0.5, 0.25, 0.25]]))
    labels = torch.tensor([0, 1, UNKNOWN])
    expected = 1 - np.mean([(2 * 0.8 + 1) / (1.1 + 1 + 1), (2 * 0.6 + 1) / (0.7 + 1 + 1), 1 / (0.2 + 0 + 1)])
    assert float(loss.dice(logits, labels)) == pytest.approx(expected, rel=1e-5)
    certain = torch.tensor([[50.0, 0, 0], [0, 50.0, 0]])
    assert float(loss.dice(certain, torch.tensor([0, 1]), smooth=1e-6)) < 0.34
    both = loss.combined(logits, labels, torch.ones(3), 0.5)
    alone = loss.cross_entropy(logits, labels, torch.ones(3))
    assert float(both - alone) == pytest.approx(0.5 * expected, rel=1e-4)
