"""Point-to-point ICP as published.

Besl and McKay 1992 (doi:10.1109/34.121791) with a largest correspondence distance and the closed-form solution by
singular value decomposition (Arun et al. 1987, doi:10.1109/TPAMI.1987.4767965).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .errors import InputError
from .pose import Pose
from .progress import Progress

Float = NDArray[np.float64]

_RMSE_CHANGE = 1e-6  # metres; smaller changes of the inlier RMSE end the iterations
_CHUNK = 50_000


@dataclass(frozen=True)
class IcpResult:
    """``pose`` moves the moving cloud onto the reference; ``rmse`` (m) is over the ``inliers`` pairs near enough."""

    pose: Pose
    rmse: float
    inliers: int
    iterations: int
    converged: bool


def icp(
    reference: Float,
    moving: Float,
    *,
    distance: float,
    iterations: int,
    tree: cKDTree | None = None,
    progress: Progress | None = None,
) -> IcpResult:
    """Register ``moving`` (m, 3) to ``reference`` (n, 3), metres in local coordinates.

    Args:
        distance: pairs farther apart are ignored, metres.
        iterations: upper limit; it stops earlier once the inlier RMSE changes by less than a micrometre.
        tree: of the reference, if there is one already.

    Raises:
        InputError: hardly any pair lies within the distance.
    """
    progress = progress or Progress()
    lookup = _Lookup(tree or cKDTree(reference, balanced_tree=False, compact_nodes=False), distance)
    pose, previous, done, converged = Pose.identity(), np.inf, 0, False
    near, number = lookup.pairs(moving)
    while True:
        inside = near <= distance
        if np.count_nonzero(inside) < 3:
            raise InputError(
                f"Only {np.count_nonzero(inside)} points of the later epoch lie within {distance:g} m of the earlier "
                "one; give a larger correspondence distance or use the robust method."
            )
        rmse = float(np.sqrt(np.mean(near[inside] ** 2)))
        converged = abs(previous - rmse) < _RMSE_CHANGE
        if converged or done == iterations:
            return IcpResult(pose, rmse, int(np.count_nonzero(inside)), done, converged)
        pose = rigid_fit(moving[inside], reference[number[inside]])
        previous, done = rmse, done + 1
        progress.update(done / iterations, f"icp, inlier RMSE {rmse:.4f} m")
        near, number = lookup.pairs(pose.apply(moving))


def rigid_fit(source: Float, target: Float) -> Pose:
    """The rigid motion that brings ``source`` (n, 3) closest to ``target`` (n, 3) in the least-squares sense."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((source - a).T @ (target - b))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left @ mirror @ right).T
    return Pose(rotation, b - rotation @ a)


class _Lookup:
    """Nearest neighbours of points that move little from call to call, exact and mostly without a search.

    A point that was d1 from its neighbour and d2 from the next one keeps that neighbour for as long as it has moved
    by no more than (d2 - d1) / 2.
    """

    def __init__(self, tree: cKDTree, distance: float) -> None:
        self.tree, self.distance = tree, distance
        self.horizon = 1.5 * distance
        self._place: Float | None = None

    def pairs(self, places: Float) -> tuple[Float, NDArray[np.int64]]:
        """Distance (n,) and number of the nearest point; infinity where that is surely beyond the distance."""
        if self._place is None:
            self._place = places.copy()
            self._number = np.empty(len(places), dtype=np.int64)
            self._slack = np.empty(len(places))
            self._search(places, np.arange(len(places)))
        else:
            moved = np.linalg.norm(places - self._place, axis=1)
            self._search(places, np.flatnonzero(moved >= self._slack))
        near = np.full(len(places), np.inf)
        known = self._number < self.tree.n
        offset = places[known] - self.tree.data[self._number[known]]
        near[known] = np.sqrt(np.einsum("ij,ij->i", offset, offset))
        return near, self._number

    def _search(self, places: Float, stale: NDArray[np.int64]) -> None:
        assert self._place is not None
        count = min(2, self.tree.n)
        for start in range(0, len(stale), _CHUNK):
            chosen = stale[start : start + _CHUNK]
            near, number = self.tree.query(
                places[chosen], k=list(range(1, count + 1)), distance_upper_bound=self.horizon, workers=-1
            )
            second = np.minimum(near[:, -1], self.horizon) if count == 2 else np.full(len(chosen), self.horizon)
            # without any neighbour within the horizon there is none within the distance until it has moved so far
            slack = np.where(np.isfinite(near[:, 0]), (second - near[:, 0]) / 2, self.horizon - self.distance)
            self._place[chosen], self._number[chosen], self._slack[chosen] = places[chosen], number[:, 0], slack
