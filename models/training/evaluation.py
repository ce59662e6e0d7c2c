"""Scores of labels against the truth, by class, and the calibration of their probabilities.

No point is left out of the scores, those near the limit between two labels included.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ..configuration import CLASSES
from ..inference.calibration_bins import BINS, Labels, calibration_bins, calibration_error


def confusion(truth: Labels, predicted: Labels, classes: int = len(CLASSES)) -> NDArray[np.int64]:
    """(classes, classes) counts: rows are the truth, columns the prediction."""
    index = truth.astype(np.int64) * classes + predicted
    return np.bincount(index, minlength=classes**2).reshape(classes, classes)


def overall_accuracy(counts: NDArray[np.int64]) -> float:
    """Share of points that have their true class."""
    return float(np.trace(counts) / max(1, counts.sum()))


def intersection_over_union(counts: NDArray[np.int64]) -> Float:
    """(classes,) true positives over all points of the class in truth or prediction; NaN where it is in neither."""
    hit = np.diag(counts).astype(np.float64)
    union = counts.sum(axis=0) + counts.sum(axis=1) - hit
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(union > 0, hit / union, np.nan)


def label_figures(counts: NDArray[np.int64]) -> dict[str, Any]:
    """Accuracy, mean IoU, IoU by class and the (classes, classes) ``counts`` themselves, rounded, ready for JSON."""
    iou = intersection_over_union(counts)
    return {
        "overall_accuracy": round(overall_accuracy(counts), 4),
        "mean_iou": round(float(np.nanmean(iou)), 4),
        "iou": {name: rounded(float(value)) for name, value in zip(CLASSES, iou)},
        "confusion": counts.tolist(),
    }


@dataclass
class LabelScores:
    """Sums over clouds; ``add_points`` takes one cloud, ``summary`` gives the scores of all so far."""

    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros((len(CLASSES), len(CLASSES)), dtype=np.int64))
    bins: Float = field(default_factory=lambda: np.zeros((BINS, 3)))  # points, confidence, hits
    scenes: int = 0

    def add_points(self, labels: Labels, probabilities: NDArray[np.floating]) -> None:
        """Score a cloud's labelled points: (n,) classes, (n, classes)."""
        self.counts += confusion(labels, probabilities.argmax(axis=1).astype(np.uint8))
        self.bins += calibration_bins(labels, probabilities)
        self.scenes += 1

    def summary(self) -> dict[str, Any]:
        """All scores by name, rounded, ready for JSON."""
        return {
            "scenes": self.scenes,
            "points": int(self.counts.sum()),
            **label_figures(self.counts),
            "calibration_error": round(calibration_error(self.bins), 4),
            "reliability": [[round(float(x), 4) for x in row] for row in _reliability(self.bins)],
        }


def rounded(value: float) -> float | None:
    """For JSON, which has no NaN: None where there is nothing to score."""
    return round(value, 4) if np.isfinite(value) else None


def _reliability(bins: Float) -> list[tuple[float, float, float]]:
    """Mean confidence, accuracy and share of points of each bin that has any."""
    total = bins[:, 0].sum()
    return [(c / n, h / n, n / total) for n, c, h in bins if n]
