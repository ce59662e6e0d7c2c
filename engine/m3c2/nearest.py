"""Distances to the nearest points of a cloud, in memory or on the disk."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Float
from ..pointcloud.in_parts import every_of
from .surveys import HeldSurvey, StoredSurvey, Survey, pieces

_SAMPLE_POINTS = 200_000  # of a cloud on the disk, which say how far to look at most


def nearest_distances(survey: Survey, places: Float, number: int = 1) -> Float:
    """How far (m,) the ``number``-th nearest point is from each of the places (m, 2) or (m, 3); infinite without.

    Args:
        places: of two coordinates, to look from above.
    """
    axes = places.shape[1]
    if isinstance(survey, HeldSurvey):
        return _distances(survey.xyz[:, :axes], places, number)[:, -1]
    found = np.full((len(places), number), np.inf)
    most = _at_most(survey, places, number)
    for box, near in pieces(survey):
        here = np.flatnonzero(box.distance(places) <= np.minimum(most, found[:, -1]))
        if len(here):
            both = np.hstack([found[here], _distances(near.xyz[:, :axes], places[here], number)])
            found[here] = np.sort(both, axis=1)[:, :number]
    return found[:, -1]


def _at_most(survey: StoredSurvey, places: Float, number: int) -> Float:
    """Distances (m,) that those sought are not above."""
    some = every_of(survey.cloud, max(1, len(survey) // _SAMPLE_POINTS))[:, : places.shape[1]]
    return _distances(some, places, number)[:, -1]


def _distances(points: Float, places: Float, number: int) -> Float:
    """To the nearest ones (m, number), ascending."""
    # the default build sorts and shrinks at a cost that so few queries do not return
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    return np.asarray(tree.query(places, k=list(range(1, number + 1)))[0])
