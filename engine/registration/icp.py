"""Point-to-point ICP as published.

Besl and McKay 1992 (doi:10.1109/34.121791) with a largest correspondence distance and the closed-form solution by
singular value decomposition (Arun et al. 1987, doi:10.1109/TPAMI.1987.4767965).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Float
from ..core.errors import InputError
from ..core.progress import Progress
from ..geometry.pose import Pose
from .measured import Solution
from .tracked_neighbours import TrackedNeighbours

_MIN_RMSE_CHANGE_M = 1e-6  # metres; smaller changes of the inlier RMSE end the iterations


def icp(
    reference: Float,
    moving: Float,
    *,
    distance: float,
    iterations: int,
    tree: cKDTree | None = None,
    progress: Progress | None = None,
) -> Solution:
    """The motion of ``moving`` (m, 3) onto ``reference`` (n, 3), metres in local coordinates.

    Args:
        distance: pairs farther apart are ignored, metres.
        iterations: upper limit; it stops earlier once the inlier RMSE changes by less than a micrometre.
        tree: of the reference, if there is one already.

    Raises:
        InputError: hardly any pair lies within the distance.
    """
    progress = progress or Progress()
    every = np.arange(len(moving))
    neighbours = TrackedNeighbours(tree or cKDTree(reference, balanced_tree=False, compact_nodes=False), len(moving))
    pose, previous, done, converged = Pose.identity(), np.inf, 0, False
    near, number = neighbours.nearest(every, moving, distance)
    while True:
        inside = near <= distance
        if np.count_nonzero(inside) < 3:
            raise InputError(
                f"Only {np.count_nonzero(inside)} points of the later epoch lie within {distance:g} m of the earlier "
                "one; give a larger correspondence distance or use the robust method."
            )
        rmse = float(np.sqrt(np.mean(near[inside] ** 2)))
        converged = abs(previous - rmse) < _MIN_RMSE_CHANGE_M
        if converged or done == iterations:
            return Solution(pose, done, converged)
        pose = rigid_fit(moving[inside], reference[number[inside]])
        previous, done = rmse, done + 1
        progress.update(done / iterations, f"icp, inlier RMSE {rmse:.4f} m")
        near, number = neighbours.nearest(every, pose.apply(moving), distance)


def rigid_fit(source: Float, target: Float) -> Pose:
    """The rigid motion that brings ``source`` (n, 3) closest to ``target`` (n, 3) in the least-squares sense."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((source - a).T @ (target - b))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left @ mirror @ right).T
    return Pose(rotation, b - rotation @ a)
