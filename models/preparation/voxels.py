"""Averaging points in voxels, and the order in which neighbours in space are neighbours in memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float, Index


@dataclass(frozen=True)
class VoxelGrid:
    """Points (m, 3) averaged in voxels, in Morton order of their columns; ``inverse`` (n,) is each input's voxel."""

    points: Float
    inverse: Index
    count: Index

    def majority(self, values: NDArray[np.uint8], kinds: int) -> NDArray[np.uint8]:
        """The value that most points of each voxel have; the lower one where two have as many."""
        votes = np.bincount(self.inverse * kinds + values, minlength=len(self.points) * kinds)
        return votes.reshape(-1, kinds).argmax(axis=1).astype(np.uint8)


def voxel_grid(xyz: Float, size: float) -> VoxelGrid:
    """Average (n, 3) points in cubes of side ``size`` m that are aligned with the origin."""
    cell = np.floor(xyz * (1.0 / size)).astype(np.int64)
    cell -= cell.min(axis=0)
    # Column in Morton order, then height: one number a voxel.
    layers = int(cell[:, 2].max()) + 1
    key = morton(cell[:, 0], cell[:, 1]) * layers + cell[:, 2]
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    first = np.ones(len(ordered), dtype=bool)
    first[1:] = ordered[1:] != ordered[:-1]
    starts = np.flatnonzero(first)
    inverse = np.empty(len(xyz), dtype=np.int64)
    inverse[order] = np.cumsum(first) - 1
    count = np.diff(np.append(starts, len(ordered)))
    middle = xyz.mean(axis=0)
    points = np.add.reduceat(xyz[order] - middle, starts, axis=0) / count[:, None] + middle
    return VoxelGrid(points, inverse, count)


def morton(i: Index, j: Index) -> Index:
    """Morton (Z-order) code of non-negative integers below 2^20: near in the plane is near in the order."""
    return _spread(i) | (_spread(j) << 1)


def _spread(x: Index) -> Index:
    x = x & 0xFFFFF
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F)):
        x = (x | (x << shift)) & mask
    x = (x | (x << 2)) & 0x3333333333333333
    return (x | (x << 1)) & 0x5555555555555555
