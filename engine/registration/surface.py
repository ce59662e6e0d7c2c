"""A point cloud as a surface: voxel means, their neighbours, and a plane through each neighbourhood."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float, Index
from ..geometry.principal_axes import thinnest
from ..geometry.voxels import voxel_average
from ..statistics.robust import robust_scale
from .kernels import Planes, as_planes, neighbourhood_moments

NOISE_FLOOR = 1e-3  # metres; no scanner is better, and a scale of zero has no weights
NEIGHBOURS = 12  # of a plane; fewer follow finer relief, more average more noise
_MAX_THICKNESS_RATIO = 0.5  # a neighbourhood thicker than this share of its width has no normal worth using
_LEAF_POINTS = 24  # points; measured, faster than the default where all points ask for their neighbours
_CHUNK_POINTS = 50_000  # points a native call, so that cancelling takes effect in time


class Surface:
    """Voxel means ``points`` (m, 3) of a cloud, and planes that are fitted where they are first asked for.

    ``centroids`` and ``normals`` (m, 3), upwards, and ``planar`` (m,) are valid where ``fit`` was called for.
    ``plants`` (m,) is the error of the heights by plants and ``plant_heights`` (m,) their height, metres; None where
    it is not known.
    """

    def __init__(
        self, xyz: Float, voxel: float, plants: Float | None = None, plant_heights: Float | None = None
    ) -> None:
        known = [values for values in (plants, plant_heights) if values is not None]
        means = voxel_average(xyz, voxel, np.column_stack(known) if known else None)
        self.points = np.ascontiguousarray(means[:, :3]) if known else means
        self.plants = None if plants is None else np.ascontiguousarray(means[:, 3])
        self.plant_heights = None if plant_heights is None else np.ascontiguousarray(means[:, -1])
        # the default build sorts and shrinks at a cost that so few queries do not return
        self.tree = cKDTree(self.points, balanced_tree=False, compact_nodes=False, leafsize=_LEAF_POINTS)
        self.neighbours = min(NEIGHBOURS, len(self.points))
        self.centroids = np.zeros_like(self.points)
        self.normals = np.zeros_like(self.points)
        self.planar: Bool = np.zeros(len(self.points), dtype=bool)
        self._fitted: Bool = np.zeros(len(self.points), dtype=bool)
        # largest error by plants of the points around, where a plane was fitted
        self._most_plants = np.zeros(0 if plants is None else len(self.points))
        self.spacing = self._spacing()

    @property
    def planes(self) -> Planes:
        """The surface as ``kernels`` take it."""
        return as_planes(self.points, self.centroids, self.normals, self.planar)

    def sample(self, limit: int, eligible: Bool | None = None) -> Index:
        """Numbers of at most ``limit`` points, evenly spread, always the same; of the ``eligible`` (m,) only."""
        numbers = np.arange(len(self.points)) if eligible is None else np.flatnonzero(eligible)
        if len(numbers) <= limit:
            return numbers.astype(np.int64)
        # the first ones of one order: what was found out of a smaller sample serves a larger one
        order = np.random.default_rng(0).permutation(len(numbers))
        chosen: Index = np.sort(numbers[order[:limit]]).astype(np.int64)
        return chosen

    def fit(self, numbers: Index) -> None:
        """Fit the planes of the points ``numbers`` by principal components, unless that was done before."""
        asked = np.zeros(len(self.points), dtype=bool)
        asked[numbers] = True
        missing = np.flatnonzero(asked & ~self._fitted)
        for start in range(0, len(missing), _CHUNK_POINTS):
            chosen = missing[start : start + _CHUNK_POINTS]
            near = np.asarray(
                self.tree.query(self.points[chosen], k=list(range(1, self.neighbours + 1)), workers=-1)[1]
            )
            if self.plants is not None:
                self._most_plants[chosen] = self.plants[near].max(axis=1)
            moments = neighbourhood_moments(self.points, chosen, near)
            thin, wide, normal = thinnest(*moments[3:])
            self.centroids[chosen] = moments[:3].T
            self.normals[chosen] = normal * np.where(normal[:, 2:] < 0, -1.0, 1.0)
            self.planar[chosen] = thin < _MAX_THICKNESS_RATIO**2 * wide
        self._fitted[missing] = True

    def bare(self, limit: float) -> Bool:
        """Points (m,) over which, and over whose neighbours, the error by plants is at most ``limit`` metres."""
        if self.plants is None:
            return np.ones(len(self.points), dtype=bool)
        bare: Bool = self.plants <= limit
        bare[self._fitted] &= self._most_plants[self._fitted] <= limit
        some = np.flatnonzero(bare & ~self._fitted)
        for start in range(0, len(some), _CHUNK_POINTS):
            chosen = some[start : start + _CHUNK_POINTS]
            near = np.asarray(
                self.tree.query(self.points[chosen], k=list(range(1, self.neighbours + 1)), workers=-1)[1]
            )
            bare[chosen] = (self.plants[near] <= limit).all(axis=1)
        return bare

    @cached_property
    def noise(self) -> float:
        """Scale of the points about the planes through their own neighbourhoods, metres."""
        some = self.sample(20_000)
        self.fit(some)
        some = some[self.planar[some]]
        distance = np.einsum("ij,ij->i", self.points[some] - self.centroids[some], self.normals[some])
        return max(robust_scale(distance), NOISE_FLOOR)

    @cached_property
    def radius(self) -> float:
        """Typical distance of the points from the origin, metres, not affected by stray points."""
        return 1.2 * float(np.median(np.linalg.norm(self.points, axis=1)))

    def _spacing(self) -> float:
        """Side of the square that one point has to itself, metres."""
        some = self.points[self.sample(2000)]
        distance = np.asarray(self.tree.query(some, k=[self.neighbours])[0])
        return float(np.median(distance)) * float(np.sqrt(np.pi / self.neighbours))


def nearest(tree: cKDTree, xyz: Float, reach: float = np.inf) -> tuple[Float, Index]:
    """As ``tree.query``, in pieces that leave room for a cancel."""
    distance, number = np.empty(len(xyz)), np.empty(len(xyz), dtype=np.int64)
    for start in range(0, len(xyz), _CHUNK_POINTS):
        piece = slice(start, start + _CHUNK_POINTS)
        distance[piece], number[piece] = tree.query(xyz[piece], distance_upper_bound=reach, workers=-1)
    return distance, number
