"""Places of a surface that slid along it, which agree point by point and still pull a registration along.

Windows of patches show them (``moving_windows``), groups of patches say whether they slid or only sank
(``slid_groups``), and what may still pull unseen goes into the error (``unseen_slides``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from ..geometry.pose import Pose
from .moving_windows import Windows, consensus
from .observability import Information
from .point_to_plane import Matcher
from .slid_groups import contradicting
from .surface_patches import cut, equations
from .unseen_slides import alike, unseen

_POINTS = 30  # of a patch that are paired
_MIN_PATCHES = 60
_POSES = 3
_DOUBTFUL_DEVIATIONS = 4.5  # standard deviations of a window's motion; where none is beyond, nothing is looked for
_MIN_STEP_M = 1e-3  # of all windows together, below which they are not drawn again
_MIN_PULL_M = 1e-3  # of the whole; less is not worth leaving anything out
_MAX_ACROSS_RATIO = 0.3  # of a pull: its part along the normal by all of it
_MAX_SHARE = 0.6  # of the surface: more is not the exception


@dataclass(frozen=True)
class Places:
    """``weight`` (k,) of the surface around each ``centre`` (k, 3; reference frame), ``side`` (m) apart about."""

    centre: Float
    weight: Float
    side: float

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.centre)

    def at(self, places: Float) -> Float:
        """(n,) weights of ``places`` (n, 3): of the nearest centre to the block that each lies in."""
        cell = np.floor(places * (2.0 / self.side)).astype(np.int64)
        key = (cell[:, 0] + (1 << 20) << 42) + ((cell[:, 1] + (1 << 20)) << 21) + cell[:, 2] + (1 << 20)
        first, inverse = np.unique(key, return_index=True, return_inverse=True)[1:]
        nearest = self._tree.query((cell[first] + 0.5) * (self.side / 2))[1]
        return np.asarray(self.weight[nearest][inverse])


@dataclass(frozen=True)
class Moving:
    """What may be left out of a registration.

    Attributes:
        pose: on which all other places agree.
        places: the weights of all.
        normal: (k, 3) of each of them; its length is the area.
        slid: share of the surface's area that slid along itself.
        certain: whether nothing but what slid is left out; else it may have sunk, and need not pull.
        unseen: (6, 6) covariance of the pull by another slide, which chance hides, and of what patches that lie
            together have in common (rotations times a radius), square metres.
    """

    pose: Pose
    places: Places
    normal: Float
    slid: float
    certain: bool
    unseen: Float

    def along(self, first: Pose, other: Pose) -> bool:
        """Whether two poses differ along the surface, and hardly in its heights, as by the pull of a slide."""
        away = other.apply(self.places.centre) - first.apply(self.places.centre)
        area = np.linalg.norm(self.normal, axis=1)
        whole = np.average((away**2).sum(axis=1), weights=area)
        across = np.average(np.einsum("ij,ij->i", away, self.normal / area[:, None]) ** 2, weights=area)
        return bool(across < _MAX_ACROSS_RATIO**2 * whole)


def moving_places(matcher: Matcher, pose: Pose, known: Information) -> tuple[Moving, ...]:
    """Places that contradict the others at a pose, all of them first, then those that slid alone; none without any.

    Args:
        known: what the surfaces fix; nothing is moved in other directions.
    """
    patches = cut(matcher.moving, 3 * matcher.noise, matcher.firm)
    fixed = known.directions[:, known.observable]
    if len(patches) < _MIN_PATCHES or not fixed.shape[1]:
        return ()
    at = pose
    for _ in range(_POSES):
        system = equations(matcher, patches, at, 3 * matcher.spacing, _POINTS)
        drawn = Windows.of(system, patches, at, matcher.radius)
        if drawn is None:
            return ()
        windows, found = drawn, consensus(drawn, fixed)
        if found.away.max() < _DOUBTFUL_DEVIATIONS:
            return ()
        at = at.moved(found.motion, matcher.radius)
        if float(np.linalg.norm(found.motion)) < _MIN_STEP_M:
            break
    groups = contradicting(windows, found, fixed)
    slid = float(windows.area[groups.slid].sum() / windows.area.sum())
    choices = [(groups.slid | groups.others, False)] if groups.others.any() else []
    return tuple(
        Moving(
            at,
            Places(windows.centre, np.where(out, 0.0, 1.0), patches.width),
            windows.normal,
            slid,
            certain,
            unseen(windows, np.where(out, 0.0, 1.0), fixed) + alike(windows, np.where(out, 0.0, 1.0), fixed),
        )
        for out, certain in [*choices, (groups.slid, True)]
        if _pulls(windows, out, fixed)
    )


def _pulls(windows: Windows, out: Bool, fixed: Float) -> bool:
    """Whether there is anything to leave ``out`` (k,), not too much of it, and worth it."""
    if not 0.0 < float(windows.area[out].sum() / windows.area.sum()) <= _MAX_SHARE:
        return False
    rest, everything = np.where(out, 0.0, 1.0), np.ones(len(out))
    return float(np.linalg.norm(windows.solved(rest, fixed) - windows.solved(everything, fixed))) >= _MIN_PULL_M
