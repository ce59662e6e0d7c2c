"""Neighbour pyramids: what a network of random decimation looks up, computed once a block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Float32 = NDArray[np.float32]
Index = NDArray[np.int32]


@dataclass(frozen=True)
class Level:
    """One level of a block.

    ``neighbours`` (n, k): the k nearest points of each, itself the first. ``kept`` (n // decimation, at least 1): the
    points that the next level has, rising. ``nearest`` (n,): for each point, which of the kept is nearest.
    """

    neighbours: Index
    kept: Index
    nearest: Index


def build_pyramid(
    xyz: NDArray[np.floating],
    levels: int,
    neighbours: int,
    decimation: int,
    rng: np.random.Generator,
    workers: int = 1,
) -> tuple[Level, ...]:
    """Neighbours, random decimation and upsampling for each level of a block.

    Args:
        xyz: (n, 3) metres, at least one point. Points that are near in memory and in space are searched faster.
        workers: threads of the neighbour search.

    A level of fewer than ``neighbours`` points repeats its farthest neighbour.
    """
    built: list[Level] = []
    points = np.ascontiguousarray(xyz, dtype=np.float64)
    tree = _tree(points)
    for _ in range(levels):
        found = _search(tree, points, min(neighbours, len(points)), workers)
        if found.shape[1] < neighbours:
            found = np.pad(found, ((0, 0), (0, neighbours - found.shape[1])), mode="edge")
        kept = np.sort(rng.choice(len(points), max(1, len(points) // decimation), replace=False)).astype(np.int32)
        below = points[kept]
        tree_below = _tree(below)
        nearest = _search(tree_below, points, 1, workers)[:, 0]
        built.append(Level(found, kept, nearest))
        points, tree = below, tree_below
    return tuple(built)


def _tree(points: NDArray[np.float64]) -> cKDTree:
    # Splitting at the middle rather than the median builds four times as fast; blocks are even enough for it.
    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def _search(tree: cKDTree, points: NDArray[np.float64], k: int, workers: int) -> Index:
    _, found = tree.query(points, k=k, workers=workers)
    return np.asarray(found, dtype=np.int32).reshape(len(points), k)
