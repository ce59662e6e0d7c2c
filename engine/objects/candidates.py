"""Returns that stand where the other survey saw through to its ground, and groups of them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..core.arrays import Float, Index
from ..geometry.columns import greatest, least
from ..ground.result import MIN_VEGETATION_HEIGHT_M
from .survey import Survey

MIN_HEIGHT_M = MIN_VEGETATION_HEIGHT_M
"""What stands lower over the ground is no object."""
LOW_M = MIN_HEIGHT_M / 2
"""Returns up to this height over the ground are taken as the ground."""
SEEN_M = 1.0
"""The other survey saw the ground of a place if it has a return of it so near, as for a comparison of the ground."""
_LINKED_SPACINGS, _MIN_LINK_M = 2.5, 0.5
_MATCHED_SPACINGS, _MIN_MATCH_M, _MATCHED, _MATCHED_SHARE = 1.5, 0.3, 4, 0.7


@dataclass(frozen=True)
class Heights:
    """A survey with the heights (n,) m of its returns over the ground of the survey without the objects."""

    survey: Survey
    height: Float


def link_length(spacing: float) -> float:
    """Distance (m) up to which returns are of one object, at a ``spacing`` in m."""
    return max(_MIN_LINK_M, _LINKED_SPACINGS * spacing)


def changed_returns(owner: Heights, other: Heights) -> Index:
    """(m,) returns of ``owner`` over ground that ``other`` saw, to which it has none about as high close by."""
    raised = np.flatnonzero(owner.height > MIN_HEIGHT_M)
    low = other.height < LOW_M
    if not len(raised) or not low.any():
        return raised[:0]
    xyz, height = owner.survey.xyz[raised], owner.height[raised]
    seen = cKDTree(other.survey.xyz[low, :2]).query(xyz[:, :2], distance_upper_bound=SEEN_M, workers=-1)[0]
    kept = np.isfinite(seen)
    raised, xyz, height = raised[kept], xyz[kept], height[kept]
    standing = np.flatnonzero(~low)
    if not len(raised) or not len(standing):
        return raised
    reach = max(_MIN_MATCH_M, _MATCHED_SPACINGS * other.survey.spacing)
    tree = cKDTree(other.survey.xyz[standing])
    _, near = tree.query(xyz, k=_MATCHED, distance_upper_bound=reach, workers=-1)
    there = np.append(other.height[standing], -np.inf)[near]
    return raised[~(there >= _MATCHED_SHARE * height[:, None]).any(axis=1)]


def groups(places: Float, sides: Float) -> list[Index]:
    """Places (n, 3) that hang together by voxels of three ``sides``, m: indices (m,) of each group."""
    if not len(places):
        return []
    place = np.floor((places - least(places)) / sides).astype(np.int64) + 1
    spans = greatest(place) + 2
    strides = np.array([spans[1] * spans[2], spans[2], 1], dtype=np.int64)
    voxels, of_point = np.unique(place @ strides, return_inverse=True)
    links = [(np.arange(len(voxels)), np.arange(len(voxels)))]
    for step in product((-1, 0, 1), repeat=3):
        if step > (0, 0, 0):
            wanted = voxels + int(np.array(step) @ strides)
            found = np.minimum(np.searchsorted(voxels, wanted), len(voxels) - 1)
            joined = np.flatnonzero(voxels[found] == wanted)
            links.append((joined, found[joined]))
    rows, columns = (np.concatenate(ends) for ends in zip(*links, strict=True))
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(voxels),) * 2)
    label = connected_components(graph, directed=False)[1][of_point.ravel()]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
