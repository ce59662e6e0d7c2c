"""Returns that stand where the other survey saw through to its ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Float, Index
from ..geometry.near_places import near_places
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
    kept = near_places(other.survey.xyz[low], xyz, SEEN_M)
    raised, xyz, height = raised[kept], xyz[kept], height[kept]
    standing = np.flatnonzero(~low)
    if not len(raised) or not len(standing):
        return raised
    reach = max(_MIN_MATCH_M, _MATCHED_SPACINGS * other.survey.spacing)
    tree, others = cKDTree(other.survey.xyz[standing]), np.append(other.height[standing], -np.inf)
    left = np.arange(len(raised))
    for count in (1, _MATCHED):  # for most the nearest one decides, which is found sooner
        _, near = tree.query(xyz[left], k=range(1, count + 1), distance_upper_bound=reach)
        left = left[~(others[near] >= _MATCHED_SHARE * height[left, None]).any(axis=1)]
    return raised[left]
