"""Nearest neighbours of points that move little from call to call, exact and mostly without a search.

A point that was d1 from its neighbour and d2 from the next one keeps that neighbour for as long as it has moved by less
than (d2 - d1) / 2 (Greenspan and Godin 2001, doi:10.1109/IM.2001.924426, by the triangle inequality).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Float, Index

_CHUNK_POINTS = 50_000  # points a native call, so that cancelling takes effect in time
# times the reach: how far a search looks, so that points without a neighbour are not searched each time
_SEARCH_REACHES = 1.5


class TrackedNeighbours:
    """Neighbours, in a tree, of ``count`` points that are given by their numbers and their present positions."""

    def __init__(self, tree: cKDTree, count: int) -> None:
        self.tree = tree
        self._place = np.zeros((count, 3))
        self._number = np.full(count, tree.n, dtype=np.int64)
        # how far a point may move and keep its neighbour; without one, how far around it nothing was found
        self._slack = np.full(count, -np.inf)

    def nearest(self, which: Index, places: Float, reach: float) -> tuple[Float, Index]:
        """As ``cKDTree.query`` with a largest distance ``reach``: infinity and ``tree.n`` beyond it, in metres.

        Args:
            which: (n,) numbers of the points, each once.
            places: (n, 3) where they are.
        """
        safe = np.take(self._slack, which) - np.where(np.take(self._number, which) < self.tree.n, 0.0, reach)
        stale = np.flatnonzero(~(_distance(places, np.take(self._place, which, axis=0)) < safe))
        for start in range(0, len(stale), _CHUNK_POINTS):
            chosen = stale[start : start + _CHUNK_POINTS]
            self._search(which[chosen], np.take(places, chosen, axis=0), _SEARCH_REACHES * reach)
        number = np.take(self._number, which)
        near = _distance(places, np.take(self.tree.data, number, axis=0, mode="clip"))
        beyond = (number == self.tree.n) | ~(near < reach)
        near[beyond], number[beyond] = np.inf, self.tree.n
        return near, number

    def _search(self, which: Index, places: Float, horizon: float) -> None:
        ranks = [1, 2] if self.tree.n > 1 else [1]
        near, number = self.tree.query(places, k=ranks, distance_upper_bound=horizon, workers=-1)
        second = np.minimum(near[:, -1], horizon) if len(ranks) > 1 else horizon
        found = np.isfinite(near[:, 0])
        self._place[which], self._number[which] = places, number[:, 0]
        self._slack[which] = np.where(found, (second - np.where(found, near[:, 0], 0.0)) / 2, horizon)


def _distance(a: Float, b: Float) -> Float:
    offset = a - b
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", offset, offset)))
