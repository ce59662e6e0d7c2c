"""Whether a group of patches slid along itself, or only sank or rose, which feigns a motion along the surface.

Where a step or a bowl of the distance along the normal meets relief, a window's common offset and tilts do not take it
out, and what is left looks like a motion along the surface. Each patch has its own offset and its own tilts here, so
that only the relief within patches is asked. What patches of a slide then ask for is alike; what a step leaves at the
edge of a sunken place is not. The scatter of the patches is the measure (a t test with the covariance of clusters;
Liang and Zeger 1986, doi:10.1093/biomet/73.1.13).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from ..core.arrays import Bool, Float, Index
from .moving_windows import Consensus, Slides, Windows

_DEVIATIONS = 5.5  # of a window's motion that begins a group; measured, 5.1 at most on 18 pairs of which nothing moved
_DEVIATIONS_OF_GROUP, _GROUP_WIDTHS = 2.5, 1.6  # what adjoins such a window counts with it from here on
_MIN_PATCHES = 3
_MIN_COMMON_DEVIATIONS = 4.0  # of what the patches of a group have in common
_MAX_OFFSET_RATIO = 0.6  # distance along the normal by motion along the surface: a place that moved out of it by more sank


@dataclass(frozen=True)
class Group:
    """What the patches of a group have in common against the motion of the rest.

    Attributes:
        along: length of their motion along the surface, metres.
        offset: mean distance along the normal that is left with it, metres, without sign.
        deviations: of the motion from none, by the scatter of the patches.
    """

    along: float
    offset: float
    deviations: float

    @property
    def slid(self) -> bool:
        """Whether its patches move alike, along the surface more than out of it."""
        return self.deviations > _MIN_COMMON_DEVIATIONS and self.offset < _MAX_OFFSET_RATIO * self.along


def slid_patches(windows: Windows, found: Consensus) -> Bool:
    """(k,) patches of groups that contradict the rest, one of them by far more than any does by chance, and that slid.

    Args:
        found: what the rest agrees on.
    """
    some = np.flatnonzero(found.away > _DEVIATIONS_OF_GROUP)
    slid = np.zeros(len(found.away), dtype=bool)
    if not len(some):
        return slid
    number = connected_components(windows.near(_GROUP_WIDTHS)[some][:, some], directed=False)[1]
    alone = windows.scale(0.0, np.ones(len(slid)))
    for one in range(int(number.max()) + 1):
        inside = some[number == one]
        if found.away[inside].max() > _DEVIATIONS and common_motion(windows, alone, inside, found.motion).slid:
            slid[inside] = True
    return slid


def common_motion(windows: Windows, alone: Slides, some: Index, motion: Float) -> Group:
    """Of the patches with the numbers ``some``, where the rest makes the ``motion`` (6,).

    Args:
        alone: the windows of each patch alone, which have an offset and tilts for each.
    """
    nothing = Group(0.0, 0.0, 0.0)
    if len(some) < _MIN_PATCHES:
        return nothing
    shift = alone.along[some, :, 3:]
    normal = windows.normal[some].sum(axis=0)
    plane = np.linalg.svd(normal[None])[2][1:].T
    turned = shift @ plane
    left = alone.score[some] + np.einsum("kij,kj->ki", alone.information[some], alone.along[some] @ motion)
    score = np.einsum("kia,ki->ka", turned, left)
    information = np.einsum("kia,kij,kjb->kab", turned, alone.information[some], turned)
    whole = information.sum(axis=0)
    if float(np.linalg.eigvalsh(whole)[0]) <= 0:
        return nothing
    asked = -np.linalg.solve(whole, score.sum(axis=0))
    rest = score + information @ asked
    scatter = rest.T @ rest * len(some) / (len(some) - 2)
    total = score.sum(axis=0)
    squared = float(total @ np.linalg.solve(scatter + 1e-12 * np.trace(scatter) * np.eye(2), total))
    slid = np.concatenate([np.zeros(3), plane @ asked])
    return Group(float(np.linalg.norm(asked)), _offset(windows, some, motion + slid), float(np.sqrt(max(squared, 0.0))))


def _offset(windows: Windows, some: Index, motion: Float) -> float:
    """Mean distance along the normal of patches after a motion, by area, metres."""
    area = windows.area[some]
    up = windows.normal[some] / area[:, None]
    gap = np.einsum("ki,ki->k", up, (windows.vector[some] + windows.matrix[some] @ motion)[:, 3:])
    held = np.einsum("ki,kij,kj->k", up, windows.matrix[some][:, 3:, 3:], up)
    return float(abs(np.average(gap / np.maximum(held, 1e-12), weights=area)))
