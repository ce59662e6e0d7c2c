"""How many of the known hazards of simulated scenes are found, and which zones are false."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, label

from ...simulation.hazard_scenes.negatives import Negative
from ...simulation.hazard_scenes.scenes import SimulatedScene
from ..configuration import CLASSES
from ..inference.calibration_bins import Labels

ZONE_CELL = 0.5
SMALLEST_ZONE = 1.0
"""Zones are contiguous cells of ``ZONE_CELL`` m in which most points are of one hazard class, at least this many m²."""


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
