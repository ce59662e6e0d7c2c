"""Whether a group of patches slid along itself, or only sank or rose, which feigns a motion along the surface.

Where a step or a bowl of the distance along the normal meets relief, a window's common offset and tilts do not take it
out, and what is left looks like a motion along the surface. Two explanations of what the patches of a group show beyond
a common offset and common tilts are compared: one motion along the surface that all have in common, and what is then
left to each patch, an offset and tilts of its own. Where a part of the ground sank, that is nearly everything.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from ..core.arrays import Bool, Float, Index
from .moving_windows import ALONG, FREE, Consensus, Windows, changes, consensus, frames

_DEVIATIONS = 5.5  # of a window's motion that begins a group; measured, 5.1 at most on 18 pairs of which nothing moved
_DEVIATIONS_OF_GROUP, _GROUP_WIDTHS = 2.5, 1.6  # what adjoins such a window counts with it from here on
_FURTHER_DEVIATIONS, _ROUNDS, _MIN_REST = 4.0, 3, 60
_MIN_PATCHES = 8
_MIN_EXPLAINED = 0.35
_CHANCE_QUANTILE, _CHANCE_VALUE = 0.3, 0.4746  # of the sum of three squares of normal numbers, by its mean


@dataclass(frozen=True)
class Group:
    """What the patches of a group have in common against the motion of the rest.

    Attributes:
        along: length of their motion along the surface, metres.
        explained: share of what they show beyond a common offset and tilts that this motion explains; the rest are
            offsets and tilts of each patch, less what noise makes.
    """

    along: float
    explained: float

    @property
    def slid(self) -> bool:
        return self.explained > _MIN_EXPLAINED


@dataclass(frozen=True)
class Contradicting:
    """Patches (k,) of groups that contradict the rest: that ``slid``, and ``others``, which sank or are hard to say."""

    slid: Bool
    others: Bool


def contradicting(windows: Windows, found: Consensus, fixed: Float) -> Contradicting:
    """Groups that contradict the rest, one patch of each by far more than any does by chance.

    Where some slid, others that slid are looked for against what rests without them.

    Args:
        found: what the rest agrees on.
        fixed: (6, r) the directions that the surfaces fix.
    """
    groups = _groups(windows, found, _DEVIATIONS)
    if windows.area[groups.others].sum() >= windows.area[groups.slid].sum():
        # what sank turns and shifts the rest, so that some of it seems to slide
        return Contradicting(np.zeros_like(groups.slid), groups.slid | groups.others)
    slid = groups.slid.copy()
    for _ in range(_ROUNDS if slid.any() else 0):
        rest = np.flatnonzero(~slid)
        if len(rest) < _MIN_REST:
            break
        remaining = windows.chosen(rest)
        more = _groups(remaining, consensus(remaining, fixed), _FURTHER_DEVIATIONS).slid
        if not more.any():
            break
        slid[rest[more]] = True
    return Contradicting(slid, groups.others & ~slid)


def _groups(windows: Windows, found: Consensus, deviations: float) -> Contradicting:
    some = np.flatnonzero(found.away > _DEVIATIONS_OF_GROUP)
    slid, others = np.zeros((2, len(found.away)), dtype=bool)
    if len(some):
        number = connected_components(windows.near(_GROUP_WIDTHS)[some][:, some], directed=False)[1]
        for one in range(int(number.max()) + 1):
            inside = some[number == one]
            if len(inside) >= _MIN_PATCHES and found.away[inside].max() > deviations:
                kind = slid if common_motion(windows, inside, found.motion).slid else others
                kind[inside] = True
    return Contradicting(slid, others)


def common_motion(windows: Windows, some: Index, motion: Float) -> Group:
    """Of the patches with the numbers ``some`` (n,), where the rest makes the ``motion`` (6,)."""
    area = windows.area[some]
    middle = np.average(windows.centre[some], axis=0, weights=area)
    reach = float(np.sqrt(np.average(((windows.centre[some] - middle) ** 2).sum(axis=1), weights=area)))
    frame = frames(windows.normal[some].sum(axis=0)[None])
    change = changes(frame, middle[None], windows.radius, max(reach, windows.width))[0]
    gradient = windows.vector + windows.matrix @ motion
    whole = change.T @ windows.matrix[some].sum(axis=0) @ change
    pull = change.T @ gradient[some].sum(axis=0)
    still, slid = (_solved(whole, pull, list(kept)) for kept in (FREE, (*FREE, *ALONG)))
    gain = _taken(whole, pull, slid) - _taken(whole, pull, still)
    chance = float(np.quantile(_own(windows, gradient), _CHANCE_QUANTILE)) / _CHANCE_VALUE
    own = _own(windows, gradient + windows.matrix @ (change @ slid))[some]
    left = max(float(own.sum()) - len(some) * chance, 0.0)
    return Group(float(np.hypot(*slid[list(ALONG)])), gain / max(gain + left, 1e-300))


def _solved(matrix: Float, vector: Float, kept: list[int]) -> Float:
    """(6,) motion of least squares in the parameters ``kept``."""
    inner = matrix[np.ix_(kept, kept)]
    found = np.zeros(6)
    found[kept] = -np.linalg.solve(inner + 1e-6 * np.trace(inner) * np.eye(len(kept)), vector[kept])
    return found


def _taken(matrix: Float, vector: Float, motion: Float) -> float:
    """What a motion takes off the sum of squares."""
    return -float(motion @ matrix @ motion + 2 * vector @ motion)


def _own(windows: Windows, gradient: Float) -> Float:
    """(k,) what an offset and tilts of its own take off each patch's sum of squares, at a ``gradient`` (k, 6)."""
    change = changes(frames(windows.normal), windows.centre, windows.radius, windows.width / 2)[:, :, list(FREE)]
    turned = change.transpose(0, 2, 1)
    matrix, vector = turned @ windows.matrix @ change, turned @ gradient[:, :, None]
    firm = 1e-3 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] / 3
    return np.asarray((vector * np.linalg.solve(matrix + firm * np.eye(3), vector)).sum(axis=(1, 2)))
