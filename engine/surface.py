"""A point cloud as a surface: voxel means, their neighbours, and a plane through each neighbourhood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .voxel import voxel_average

Float = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

NEIGHBOURS = 12  # of a plane; fewer follow finer relief, more average more noise
_THICKNESS = 0.5  # a neighbourhood thicker than this share of its width has no normal worth using
_CHUNK = 50_000  # points a native call, so that a cancel is heard in time


class Surface:
    """Voxel means ``points`` (m, 3) of a cloud, and planes that are fitted where they are first asked for.

    ``centroids`` and ``normals`` (m, 3), ``planar`` (m,) are valid where ``fit`` was called for.
    """

    def __init__(self, xyz: Float, voxel: float) -> None:
        self.points = voxel_average(xyz, voxel)
        # the default build sorts and shrinks at a cost that so few queries do not return
        self.tree = cKDTree(self.points, balanced_tree=False, compact_nodes=False)
        self.neighbours = min(NEIGHBOURS, len(self.points))
        self.centroids = np.zeros_like(self.points)
        self.normals = np.zeros_like(self.points)
        self.planar: Mask = np.zeros(len(self.points), dtype=bool)
        self._fitted: Mask = np.zeros(len(self.points), dtype=bool)
        self.spacing = self._spacing()

    def sample(self, limit: int, eligible: Mask | None = None) -> Index:
        """Numbers of at most ``limit`` points, evenly spread, always the same; of the ``eligible`` (m,) only."""
        numbers = np.arange(len(self.points)) if eligible is None else np.flatnonzero(eligible)
        if len(numbers) <= limit:
            return numbers.astype(np.int64)
        generator = np.random.default_rng(0)
        chosen: Index = np.sort(generator.choice(numbers, limit, replace=False)).astype(np.int64)
        return chosen

    def nearest(self, xyz: Float, reach: float) -> tuple[Float, Index]:
        """Distance (n,) to the nearest point and its number; infinity and m beyond ``reach``."""
        return nearest(self.tree, xyz, reach)

    def fit(self, numbers: Index) -> None:
        """Fit the planes of the points ``numbers`` by principal components, unless that was done before."""
        missing = np.unique(numbers[~self._fitted[numbers]])
        for start in range(0, len(missing), _CHUNK):
            chosen = missing[start : start + _CHUNK]
            _, near = self.tree.query(self.points[chosen], k=self.neighbours, workers=-1)
            cloud = self.points[near]
            middle = cloud.mean(axis=1)
            local = cloud - middle[:, None]
            values, vectors = np.linalg.eigh(np.matmul(local.transpose(0, 2, 1), local))
            values = np.sqrt(np.maximum(values, 0.0))
            self.centroids[chosen] = middle
            self.normals[chosen] = vectors[:, :, 0]
            self.planar[chosen] = values[:, 0] < _THICKNESS * values[:, 1]
        self._fitted[missing] = True

    def _spacing(self) -> float:
        """Side of the square that one point has to itself, metres."""
        some = self.points[self.sample(2000)]
        distance = np.asarray(self.tree.query(some, k=[self.neighbours])[0])
        return float(np.median(distance)) * float(np.sqrt(np.pi / self.neighbours))


def nearest(tree: cKDTree, xyz: Float, reach: float = np.inf) -> tuple[Float, Index]:
    """As ``tree.query``, in pieces that leave room for a cancel."""
    distance, number = np.empty(len(xyz)), np.empty(len(xyz), dtype=np.int64)
    for start in range(0, len(xyz), _CHUNK):
        piece = slice(start, start + _CHUNK)
        distance[piece], number[piece] = tree.query(xyz[piece], distance_upper_bound=reach, workers=-1)
    return distance, number
