"""Neighbour pyramids: what a network that thins its points level by level looks up, computed once a block."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Index = NDArray[np.int32]


@dataclass(frozen=True)
class Level:
    """One level of a block.

    ``neighbours`` (n, k): the k nearest points of each, itself the first. ``kept`` (m,): the points that the next level
    has, rising; at least one. ``nearest`` (n,): for each point, which of the kept is nearest.
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
    *,
    spacing: float | None = None,
) -> tuple[Level, ...]:
    """Neighbours, decimation and upsampling for each level of a block.

    Args:
        xyz: (n, 3) metres, at least one point. Points that are near in memory and in space are searched faster.
        workers: threads of the neighbour search.
        spacing: of the points in x and y, m. The kept points then lie evenly (see ``evenly``), about n / decimation of
            them; without it n // decimation are drawn at random, as published.

    A level of fewer than ``neighbours`` points repeats its farthest neighbour.
    """
    built: list[Level] = []
    points = np.ascontiguousarray(xyz, dtype=np.float64)
    tree = _tree(points)
    for level in range(levels):
        found = _search(tree, points, min(neighbours, len(points)), workers)
        if found.shape[1] < neighbours:
            found = np.pad(found, ((0, 0), (0, neighbours - found.shape[1])), mode="edge")
        if spacing is None:
            kept = np.sort(rng.choice(len(points), max(1, len(points) // decimation), replace=False)).astype(np.int32)
        else:
            kept = evenly(points, spacing * math.sqrt(decimation) ** (level + 1), rng)
        below = points[kept]
        tree_below = _tree(below)
        nearest = _search(tree_below, points, 1, workers)[:, 0]
        built.append(Level(found, kept, nearest))
        points, tree = below, tree_below
    return tuple(built)


def evenly(points: NDArray[np.float64], side: float, rng: np.random.Generator) -> NDArray[np.int32]:
    """Numbers, rising, of the points (n, 3) nearest to the middles of squares of ``side`` m in x and y, one a square.

    The squares begin anywhere, so that a network does not learn where they lie. Random decimation leaves holes and
    heaps, which the next level's neighbourhoods inherit.
    """
    origin = rng.uniform(0.0, 1.0, 2)
    place = points[:, :2] / side + origin
    square = np.floor(place).astype(np.int64)
    off = np.square(place - square - 0.5).sum(axis=1)
    square -= square.min(axis=0)
    key = square[:, 0] * (square[:, 1].max() + 1) + square[:, 1]
    order = np.lexsort((off, key))
    _, first = np.unique(key[order], return_index=True)
    return np.sort(order[first]).astype(np.int32)


def _tree(points: NDArray[np.float64]) -> cKDTree:
    # Splitting at the middle rather than the median builds four times as fast; blocks are even enough for it.
    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def _search(tree: cKDTree, points: NDArray[np.float64], k: int, workers: int) -> Index:
    _, found = tree.query(points, k=k, workers=workers)
    return np.asarray(found, dtype=np.int32).reshape(len(points), k)
