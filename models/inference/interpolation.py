"""From voxels back to points: probabilities between the averages of the nearest voxels, weighted by distance.

A point that takes its own voxel's class makes steps of a voxel's size along every outline; weighting the nearest few by
the inverse square of their distance (Shepard 1968) brings the outline back between them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...engine.core.arrays import Float, Float32

_PART_POINTS = 200_000
_MIN_DISTANCE_VOXELS = 0.05
"""Distances are never taken for less than this share of a voxel."""


class VoxelInterpolation:
    """Values of ``points`` (m, 3), the voxels' averages in the flat frame, at any points of that frame.

    Args:
        neighbours: how many of the nearest voxels count; 1 takes the nearest alone.
        voxel: their side, m.
    """

    def __init__(self, points: Float, voxel: float, neighbours: int) -> None:
        self._neighbours = max(1, min(neighbours, len(points)))
        self._least = (_MIN_DISTANCE_VOXELS * voxel) ** 2
        # Voxels are even enough to be split at the middle, which builds four times as fast.
        self._tree = cKDTree(points, balanced_tree=False, compact_nodes=False)

    def at(self, flat: Float, values: NDArray[np.floating], workers: int = 1) -> Float32:
        """``values`` (m, c) at points (n, 3) of the flat frame: (n, c), between the smallest and the largest near."""
        result = np.empty((len(flat), values.shape[1]), dtype=np.float32)
        for start in range(0, len(flat), _PART_POINTS):
            part = slice(start, start + _PART_POINTS)
            distance, near = self._tree.query(flat[part], k=self._neighbours, workers=workers)
            if self._neighbours == 1:
                result[part] = values[near]
                continue
            weight = 1.0 / (distance**2 + self._least)
            weight /= weight.sum(axis=1, keepdims=True)
            result[part] = np.einsum("nk,nkc->nc", weight, values[near])
        return result
