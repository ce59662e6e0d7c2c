"""The classes of screening, and the one place that decides which of them a voxel, a point or a cell is of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...engine.core.arrays import Index
from ..preparation.raster_zones import Scores, zones_above

BACKGROUND, UPLIFT, SUBSIDENCE = 0, 1, 2


@dataclass(frozen=True)
class Decision:
    """How classes are told: by probabilities, or by zones of the slope's raster.

    ``zones`` (m,) are the classes of the voxels by the zones that they lie in; None where each place is of its most
    probable class, and background where a hazard is less probable than ``least``. With a ``least`` above 1 all is
    background.
    """

    least: float = 0.0
    zones: NDArray[np.uint8] | None = None

    @property
    def hidden(self) -> bool:
        """Whether no hazard is shown at all."""
        return self.least > 1.0

    def of_voxels(self, probabilities: NDArray[np.floating]) -> NDArray[np.uint8]:
        """(m,) of all voxels; probabilities (m, 3)."""
        return self.of_points(np.arange(len(probabilities)), probabilities)

    def of_points(self, place: Index, probabilities: NDArray[np.floating]) -> NDArray[np.uint8]:
        """(n,) of points in the voxels ``place`` (n,) with probabilities (n, 3) of their own."""
        if self.zones is None or self.hidden:
            return most_probable(probabilities, self.least)
        return self.zones[place]

    def of_cells(
        self, index: Index, count: NDArray[np.integer], probabilities: NDArray[np.floating]
    ) -> NDArray[np.uint8]:
        """(k,) of cells in which voxels lie: that of most of their points, by zones. Background in cells without any.

        Args:
            index: (m,) the cell of each voxel. count: (m,) its points.
            probabilities: (k, 3) means over the cells' points, NaN without any.
        """
        if self.zones is None or self.hidden:
            return most_probable(np.nan_to_num(probabilities), self.least)
        votes = [np.bincount(index, count * (self.zones == kind), len(probabilities)) for kind in range(3)]
        return np.argmax(votes, axis=0).astype(np.uint8)


def most_probable(probabilities: NDArray[np.floating], minimum: float) -> NDArray[np.uint8]:
    """(n,) the most probable class of (n, 3); background where a hazard is less probable than ``minimum``."""
    labels = probabilities.argmax(axis=1).astype(np.uint8)
    labels[(labels != BACKGROUND) & (probabilities.max(axis=1) < minimum)] = BACKGROUND
    return labels


def zone_labels(
    scores: Scores, level: float, probabilities: NDArray[np.floating], least: float = 0.0
) -> NDArray[np.uint8]:
    """Classes (columns, rows) of cells: a hazard in zones of its scores above ``level`` (see ``zones_above``), that of
    the larger score in zones of both.

    Args:
        probabilities: (3, columns, rows) of the cells. A zone that nowhere has ``least`` of its class is background.
    """
    shown = []
    for kind, score in ((UPLIFT, scores.uplift), (SUBSIDENCE, scores.subsidence)):
        zones, count = zones_above(score, level, scores.cell, scores.outline)
        highest = ndimage.maximum(probabilities[kind], zones, np.arange(1, count + 1))
        shown.append(np.concatenate([[False], np.asarray(highest) >= least])[zones])
    up, down = shown
    higher = np.nan_to_num(scores.uplift) >= np.nan_to_num(scores.subsidence)
    return np.where(up & (higher | ~down), UPLIFT, np.where(down, SUBSIDENCE, BACKGROUND)).astype(np.uint8)
