"""Scores of a screening against the truth: by class, by size and amplitude, by hard negative, and its calibration.

No point is left out of the scores, those near the limit between two labels included.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...simulation.hazard_scenes.negatives import Negative
from ...simulation.hazard_scenes.scenes import SimulatedScene
from ..configuration import CLASSES
from ..inference.calibration_bins import BINS, Labels, calibration_bins
from .scene_scores import hazard_recalls, screened_zones

AMPLITUDES = (0.0, 0.10, 0.15, 0.20, 0.30, 0.50, np.inf)
SIZES = (0.0, 1.0, 2.0, 3.0, 5.0, np.inf)
FOUND = 0.5
"""A hazard is found if this share of its points has its class."""


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


@dataclass
class Scores:
    """Sums over scenes; ``add`` takes one scene, the properties give the scores of all so far."""

    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros((len(CLASSES), len(CLASSES)), dtype=np.int64))
    bins: Float = field(default_factory=lambda: np.zeros((BINS, 3)))  # points, confidence, hits
    hazards: list[tuple[int, float, float, float]] = field(default_factory=list)  # label, amplitude, size, found share
    negatives: NDArray[np.int64] = field(default_factory=lambda: np.zeros((len(Negative), 2), dtype=np.int64))
    false_zones: dict[str, int] = field(default_factory=dict)
    zones: int = 0
    area: float = 0.0
    scenes: int = 0

    def add(self, scene: SimulatedScene, probabilities: NDArray[np.floating]) -> None:
        """Score a scene's points (n, classes)."""
        predicted = probabilities.argmax(axis=1).astype(np.uint8)
        self.counts += confusion(scene.label, predicted)
        self.bins += calibration_bins(scene.label, probabilities)
        self.hazards += hazard_recalls(scene, predicted)
        background = scene.label == 0
        for column, where in enumerate((background, background & (predicted > 0))):
            self.negatives[:, column] += np.bincount(scene.negative[where], minlength=len(Negative))
        zones, false = screened_zones(scene, predicted)
        self.zones += zones
        for kind in false:
            self.false_zones[kind] = self.false_zones.get(kind, 0) + 1
        self.area += scene.area
        self.scenes += 1

    @property
    def calibration_error(self) -> float:
        """Expected calibration error: mean distance of confidence and accuracy over bins of confidence."""
        points, confidence, hits = self.bins.T
        return float(np.abs(confidence - hits).sum() / max(1.0, points.sum()))

    def recall(self, amplitude: float = 0.0, size: float = 0.0) -> tuple[float, int]:
        """Share of the hazards of at least this amplitude and size (m) that were found, and their number."""
        found = [share >= FOUND for _, high, wide, share in self.hazards if high >= amplitude and wide >= size]
        return (float(np.mean(found)) if found else float("nan")), len(found)

    def summary(self) -> dict[str, Any]:
        """All scores by name, rounded, ready for JSON."""
        iou = intersection_over_union(self.counts)
        recalls = {f"{low:g} to {high:g}": self._recall_between(1, low, high) for low, high in pairwise(AMPLITUDES)}
        sizes = {f"{low:g} to {high:g}": self._recall_between(2, low, high) for low, high in pairwise(SIZES)}
        shares = {
            Negative(kind).name.lower(): round(float(wrong / points), 4)
            for kind, (points, wrong) in enumerate(self.negatives)
            if points
        }
        false = sum(self.false_zones.values())
        return {
            "scenes": self.scenes,
            "points": int(self.counts.sum()),
            "overall_accuracy": round(overall_accuracy(self.counts), 4),
            "mean_iou": round(float(np.nanmean(iou)), 4),
            "iou": {name: _rounded(float(value)) for name, value in zip(CLASSES, iou)},
            "confusion": self.counts.tolist(),
            "calibration_error": round(self.calibration_error, 4),
            "reliability": [[round(float(x), 4) for x in row] for row in _reliability(self.bins)],
            "recall_by_amplitude_m": recalls,
            "recall_by_size_m": sizes,
            "recall_15_cm_2_m": self._recall(self.recall(0.15, 2.0)),
            "wrong_share_by_negative": shares,
            "false_zones": dict(sorted(self.false_zones.items())),
            "false_zones_per_1000_m2": round(1000 * false / max(self.area, 1e-9), 4),
            "zones": self.zones,
        }

    def _recall_between(self, column: int, low: float, high: float) -> dict[str, float | int | None]:
        found = [row[3] >= FOUND for row in self.hazards if low <= row[column] < high]
        return self._recall((float(np.mean(found)) if found else float("nan"), len(found)))

    @staticmethod
    def _recall(recall: tuple[float, int]) -> dict[str, float | int | None]:
        return {"recall": _rounded(recall[0]), "hazards": recall[1]}


def _rounded(value: float) -> float | None:
    """For JSON, which has no NaN: None where there is nothing to score."""
    return round(value, 4) if np.isfinite(value) else None


def _reliability(bins: Float) -> list[tuple[float, float, float]]:
    """Mean confidence, accuracy and share of points of each bin that has any."""
    total = bins[:, 0].sum()
    return [(c / n, h / n, n / total) for n, c, h in bins if n]
