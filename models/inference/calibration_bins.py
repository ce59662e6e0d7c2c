"""Bins of stated probability, and how often each is right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float

Labels = NDArray[np.uint8]
BINS = 15


def calibration_bins(truth: Labels, probabilities: NDArray[np.floating]) -> Float:
    """(BINS, 3) points, sum of confidence and hits in equal bins of the highest probability."""
    confidence = probabilities.max(axis=1).astype(np.float64)
    hit = probabilities.argmax(axis=1) == truth
    index = np.minimum((confidence * BINS).astype(np.int64), BINS - 1)
    columns = (np.ones_like(confidence), confidence, hit.astype(np.float64))
    return np.stack([np.bincount(index, weights=x, minlength=BINS) for x in columns], axis=1)


def calibration_error(bins: Float) -> float:
    """Expected calibration error: mean distance of confidence and accuracy over (BINS, 3) bins of confidence."""
    points, confidence, hits = bins.T
    return float(np.abs(confidence - hits).sum() / max(1.0, points.sum()))
