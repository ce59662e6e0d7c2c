"""Losses against class imbalance: the published weighted cross-entropy, and cross-entropy by root frequency with
Dice.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from ..preparation.prepare import UNKNOWN


def published_weights(frequencies: Tensor, eps: float = 0.02, w_max: float = 10.0) -> Tensor:
    """w = min(1 / (frequency + eps), w_max) of each class; ``frequencies`` add up to 1."""
    return (1.0 / (frequencies + eps)).clamp_max(w_max)


def root_inverse_weights(frequencies: Tensor, eps: float = 1e-3) -> Tensor:
    """1 / sqrt(frequency), scaled so that the mean weight of a point is 1."""
    weights = (frequencies + eps).rsqrt()
    return weights / (weights * frequencies).sum()


def cross_entropy(logits: Tensor, labels: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean of -log p of the true class over the points whose label is known.

    Args:
        logits: (n, classes).
        labels: (n,) int64; ``UNKNOWN`` is left out. 0 where no label is known.
    """
    known = labels != UNKNOWN
    if not bool(known.any()):
        return logits.sum() * 0.0
    return functional.cross_entropy(logits[known], labels[known], weight=weights)


def dice(logits: Tensor, labels: Tensor, smooth: float = 1.0) -> Tensor:
    """1 - mean over the classes of 2 |P T| / (|P| + |T|), with the probabilities as P (Milletari et al. 2016)."""
    known = labels != UNKNOWN
    probability = torch.softmax(logits[known], dim=1)
    truth = functional.one_hot(labels[known], logits.shape[1]).to(probability.dtype)
    both = (probability * truth).sum(dim=0)
    total = probability.sum(dim=0) + truth.sum(dim=0)
    return 1.0 - ((2.0 * both + smooth) / (total + smooth)).mean()


def combined(logits: Tensor, labels: Tensor, weights: Tensor, dice_share: float) -> Tensor:
    """Cross-entropy plus ``dice_share`` times Dice."""
    loss = cross_entropy(logits, labels, weights)
    return loss + dice_share * dice(logits, labels) if dice_share else loss
