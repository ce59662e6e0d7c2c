"""Hazards are judged as a whole: where a group of neighbouring voxels is nowhere clearly a hazard, none of it is."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...engine.core.arrays import Float, Float32

REACH = 1.6
"""Voxels of a class that are at most so many sides apart belong together: about those that share an edge or corner."""


def without_faint(points: Float, probabilities: Float32, voxel: float, minimum: float) -> Float32:
    """The probabilities (m, classes), with those of faint groups' class and of the background exchanged.

    A group is faint if its class (not the first, the background) has a probability of ``minimum`` in none of its
    voxels. What decides about one voxel then decides about it: on held-out scenes such groups were hazards less often
    than the probabilities of their single voxels say.

    Args:
        points: (m, 3) the voxels' averages, metres.
        voxel: their side, metres.
    """
    labels = probabilities.argmax(axis=1)
    changed = probabilities.copy()
    for kind in range(1, probabilities.shape[1]):
        mine = np.flatnonzero(labels == kind)
        if not len(mine):
            continue
        pairs = cKDTree(points[mine]).query_pairs(REACH * voxel, output_type="ndarray")
        joined = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(len(mine),) * 2)
        count, group = connected_components(joined, directed=False)
        peak = np.zeros(count)
        np.maximum.at(peak, group, probabilities[mine, kind])
        faint = mine[peak[group] < minimum]
        changed[faint, 0], changed[faint, kind] = probabilities[faint, kind], probabilities[faint, 0]
    return changed
