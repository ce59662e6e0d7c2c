"""Scores on simulated scenes: by class, by size and amplitude of the hazards, by hard negative, and false zones."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label

from ...models.configuration import CLASSES
from ...models.inference.calibration_bins import Labels
from ...models.training.evaluation import LabelScores, rounded
from ...simulation.hazard_scenes.negatives import Negative
from ...simulation.hazard_scenes.scenes import SimulatedScene

AMPLITUDES = (0.0, 0.10, 0.15, 0.20, 0.30, 0.50, np.inf)
SIZES = (0.0, 1.0, 2.0, 3.0, 5.0, np.inf)
FOUND = 0.5
"""A hazard is found if this share of its points has its class."""
ZONE_CELL = 0.5
SMALLEST_ZONE = 1.0
"""Zones are contiguous cells of ``ZONE_CELL`` m in which most points are of one hazard class, at least this many m²."""


@dataclass
class SceneScores(LabelScores):
    """Sums over scenes; ``add`` takes one scene."""

    hazards: list[tuple[int, float, float, float]] = field(default_factory=list)  # label, amplitude, size, found share
    negatives: NDArray[np.int64] = field(default_factory=lambda: np.zeros((len(Negative), 2), dtype=np.int64))
    false_zones: Counter[str] = field(default_factory=Counter)
    zones: int = 0
    area: float = 0.0

    def add(self, scene: SimulatedScene, probabilities: NDArray[np.floating]) -> None:
        """Score a scene's points (n, classes)."""
        self.add_points(scene.label, probabilities)
        predicted = probabilities.argmax(axis=1).astype(np.uint8)
        self.hazards += hazard_recalls(scene, predicted)
        background = scene.label == 0
        for column, where in enumerate((background, background & (predicted > 0))):
            self.negatives[:, column] += np.bincount(scene.negative[where], minlength=len(Negative))
        zones, false = screened_zones(scene, predicted)
        self.zones += zones
        self.false_zones.update(false)
        self.area += scene.area

    def recall(self, amplitude: float = 0.0, size: float = 0.0) -> tuple[float, int]:
        """Share of the hazards of at least this amplitude and size (m) that were found, and their number."""
        found = [share >= FOUND for _, high, wide, share in self.hazards if high >= amplitude and wide >= size]
        return (float(np.mean(found)) if found else float("nan")), len(found)

    def summary(self) -> dict[str, Any]:
        """All scores by name, rounded, ready for JSON."""
        shares = {
            Negative(kind).name.lower(): round(float(wrong / points), 4)
            for kind, (points, wrong) in enumerate(self.negatives)
            if points
        }
        recall, count = self.recall(0.15, 2.0)
        return {
            **super().summary(),
            "recall_by_amplitude_m": self._recalls(1, AMPLITUDES),
            "recall_by_size_m": self._recalls(2, SIZES),
            "recall_15_cm_2_m": {"recall": rounded(recall), "hazards": count},
            "wrong_share_by_negative": shares,
            "false_zones": dict(sorted(self.false_zones.items())),
            "false_zones_per_1000_m2": round(1000 * self.false_zones.total() / max(self.area, 1e-9), 4),
            "zones": self.zones,
        }

    def _recalls(self, column: int, limits: tuple[float, ...]) -> dict[str, dict[str, float | int | None]]:
        """Share found and number of the hazards between the ``limits`` of a column of ``hazards``."""
        recalls: dict[str, dict[str, float | int | None]] = {}
        for low, high in pairwise(limits):
            found = [row[3] >= FOUND for row in self.hazards if low <= row[column] < high]
            share = rounded(float(np.mean(found))) if found else None
            recalls[f"{low:g} to {high:g}"] = {"recall": share, "hazards": len(found)}
        return recalls


def hazard_recalls(scene: SimulatedScene, predicted: Labels) -> list[tuple[int, float, float, float]]:
    """Label, amplitude (m), size (m) and the share of its points with the right class, of each hazard that has
    points.
    """
    table = scene.hazards
    if not len(table):
        return []
    mine = (scene.label > 0) & (scene.hazard >= 0)
    identity = scene.hazard[mine]
    size = int(max(identity.max(initial=0), table["id"].max())) + 1
    count = np.bincount(identity, minlength=size)
    right = np.bincount(identity, weights=predicted[mine] == scene.label[mine], minlength=size)
    return [
        (int(row["label"]), float(row["amplitude"]), float(row["size"]), float(right[row["id"]] / count[row["id"]]))
        for row in table
        if count[row["id"]] >= 5
    ]


def screened_zones(scene: SimulatedScene, predicted: Labels) -> tuple[int, list[str]]:
    """Number of zones that a screening shows, and for each false one the negative that most of its points lie on.

    A zone is false if none of its cells, nor any next to them, has a labelled point of its class.
    """
    plane = scene.to_plane(scene.xyz)
    cell = np.floor((plane[:, :2] - plane[:, :2].min(axis=0)) * (1.0 / ZONE_CELL)).astype(np.int64)
    shape = tuple(int(n) + 1 for n in cell.max(axis=0))
    index = cell[:, 0] * shape[1] + cell[:, 1]
    cells = shape[0] * shape[1]
    points = np.bincount(index, minlength=cells)
    zones, false = 0, []
    for value in range(1, len(CLASSES)):
        share = np.bincount(index, weights=predicted == value, minlength=cells)
        shown = ((share > 0.5 * points) & (points > 0)).reshape(shape)
        true = np.bincount(index, weights=scene.label == value, minlength=cells).reshape(shape) > 0
        near_true = binary_dilation(true, np.ones((3, 3), dtype=bool))
        marked, count = label(shown, np.ones((3, 3)))
        area = np.bincount(marked.ravel(), minlength=count + 1) * ZONE_CELL**2
        touches = np.bincount(marked.ravel(), weights=near_true.ravel(), minlength=count + 1) > 0
        large = area >= SMALLEST_ZONE
        large[0] = False
        zones += int(large.sum())
        of_point = marked.ravel()[index]
        for zone in np.flatnonzero(large & ~touches):
            kinds = np.bincount(scene.negative[of_point == zone], minlength=len(Negative))
            # Named after a negative only where that is at least a third of the zone.
            kind = int(kinds[1:].argmax()) + 1
            false.append(Negative(kind if 3 * kinds[kind] >= kinds.sum() else 0).name.lower())
    return zones, false
