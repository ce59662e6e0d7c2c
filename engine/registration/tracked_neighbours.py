"""Nearest neighbours of points that move little from call to call, exact and mostly without a search.

A point that was d1 from its neighbour and d2 from the next one keeps that neighbour for as long as it has moved by less
than (d2 - d1) / 2 (Greenspan and Godin 2001, doi:10.1109/IM.2001.924426, by the triangle inequality). A point that has
moved farther, by m, has the nearest of its k candidates as its neighbour wherever that is nearer than d(k + 1) - m.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Float, Index
from .kernels import along, kept_neighbours

_CANDIDATES = 4  # nearest points that are kept of each point; measured, more cost more than they save
_CHUNK_POINTS = 50_000  # points a native call, so that cancelling takes effect in time
# times the reach: how far a search looks, so that points without a neighbour are not searched each time
_SEARCH_REACHES = 1.5


class TrackedNeighbours:
    """Neighbours, in a tree, of ``count`` points that are given by their numbers and their present positions."""

    def __init__(self, tree: cKDTree, count: int) -> None:
        self.tree = tree
        self._points = np.ascontiguousarray(tree.data)
        self._place = np.zeros((count, 3))
        self._ranks = list(range(1, min(_CANDIDATES + 1, tree.n) + 1))
        # the nearest points, nearest first, and how far from the place all others are at least
        self._near = np.full((count, max(len(self._ranks) - 1, 1)), tree.n, dtype=np.int64)
        self._beyond = np.full(count, -np.inf)
        # how far a point may move and keep its neighbour; without one, how far around it nothing was found
        self._slack = np.full(count, -np.inf)

    def nearest(self, which: Index, places: Float, reach: float) -> tuple[Float, Index]:
        """As ``cKDTree.query`` with a largest distance ``reach``: infinity and ``tree.n`` beyond it, in metres.

        Args:
            which: (n,) numbers of the points, each once.
            places: (n, 3) where they are.
        """
        kept = self._place, self._near, self._slack, self._beyond
        near, number, sure = kept_neighbours(self._points, kept, which, places, float(reach))
        stale = np.flatnonzero(~sure)
        for start in range(0, len(stale), _CHUNK_POINTS):
            chosen = stale[start : start + _CHUNK_POINTS]
            self._search(which[chosen], np.take(places, chosen, axis=0), _SEARCH_REACHES * reach)
        number[stale] = np.take(self._near[:, 0], which[stale])
        far = _distance(places[stale], np.take(self._points, number[stale], axis=0, mode="clip"))
        beyond = (number[stale] == self.tree.n) | ~(far < reach)
        near[stale], number[stale] = np.where(beyond, np.inf, far), np.where(beyond, self.tree.n, number[stale])
        return near, number

    def _search(self, which: Index, places: Float, horizon: float) -> None:
        near, number = self.tree.query(places, k=self._ranks, distance_upper_bound=horizon, workers=-1)
        near = np.minimum(near, horizon)
        kept = number.shape[1] - 1
        self._place[which] = places
        self._near[which] = number[:, : max(kept, 1)]
        self._beyond[which] = near[:, -1] if kept else horizon
        second = near[:, 1] if kept else horizon
        found = number[:, 0] < self.tree.n
        self._slack[which] = np.where(found, (second - near[:, 0]) / 2, horizon)


def _distance(a: Float, b: Float) -> Float:
    offset = a - b
    return np.asarray(np.sqrt(along(offset, offset)))
