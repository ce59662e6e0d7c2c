"""Places of a surface that moved along it, which agree point by point and still pull a registration along.

Ground that slid keeps its distance along the normal within the noise of its points, so that no weight of single points
leaves it out; only its relief shows that it moved. The motion along the surface that the patches of a window ask for
together, apart from those of all others, does: windows that contradict the rest by more than windows do by chance lose
their weight (an M-estimator over windows in place of points; Tukey's biweight from a start by least distances).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from ..geometry.pose import Pose
from .observability import Information
from .point_to_plane import Matcher
from .surface_patches import Equations, Patches, cut, equations

WINDOW_RADII_WIDTHS = (2.5, 4.0, 6.0)  # of patches
DEVIATIONS = 5.5  # standard deviations of a window's motion; measured, 5.1 at most on 18 pairs of which nothing moved
_DOUBTFUL = 4.5  # standard deviations from which the windows are drawn again where the rest agrees
_DEVIATIONS_OF_GROUP, _GROUP_WIDTHS = 2.5, 1.6  # what adjoins such a window counts with it from here on
_POINTS = 30  # of a patch that are paired
_MIN_PATCHES, _MIN_PATCH_PAIRS, _MIN_WINDOW_PATCHES = 60, 12, 5
_CUTOFF = 4.0  # standard deviations of a window's motion from which it has no weight
_START_ROUNDS, _ROUNDS, _POSES = 12, 20, 3
_CHANCE_QUANTILE, _CHANCE_VALUE = 0.3, 0.7133  # of the square of two normal numbers; up to half of the windows may move
_MIN_INFORMATION_RATIO = 0.2  # of the median window's, below which it is noise
_MIN_STEP_M = 2e-4
_MIN_PULL_M = 1e-3  # of the whole; less is not worth leaving anything out
_MIN_DEVIATION_M = 2e-4  # of a window's motion; no two surveys agree better
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
    """What a registration found to have moved along the surface.

    Attributes:
        pose: on which all other places agree.
        places: the weights of all; None where nothing clearly moved.
        share: of the surface's area that was left out.
        unseen: (6, 6) covariance of the pull by a slide that is too small to be told from chance, and of what patches
            that lie together have in common (rotations times a radius), square metres.
    """

    pose: Pose
    places: Places | None
    share: float
    unseen: Float


def moving_places(matcher: Matcher, pose: Pose, known: Information) -> Moving | None:
    """Places that contradict the others at a pose; None where there are too few patches to say.

    Args:
        known: what the surfaces fix; nothing is moved in other directions.
    """
    patches = cut(matcher.moving, 3 * matcher.noise, matcher.firm)
    fixed = known.directions[:, known.observable]
    if len(patches) < _MIN_PATCHES or not fixed.shape[1]:
        return None
    at = pose
    for number in range(_POSES):
        system = equations(matcher, patches, at, 3 * matcher.spacing, _POINTS)
        drawn = Windows.of(system, patches, at, matcher.radius)
        if drawn is None:
            return None
        windows = drawn
        found = consensus(windows, fixed)
        if number and found.away.max() < _DOUBTFUL:
            break
        at = at.moved(found.motion, matcher.radius)
        if float(np.linalg.norm(found.motion)) < _MIN_STEP_M:
            break
    slid = clearly_moved(windows, found.away)
    if not slid.any() or windows.area[slid].sum() > _MAX_SHARE * windows.area.sum():
        slid[:] = False
    weight = np.where(slid, 0.0, 1.0)
    pull = windows.solved(weight, fixed) - windows.solved(np.ones_like(weight), fixed)
    if float(np.linalg.norm(pull)) < _MIN_PULL_M:
        slid[:], weight[:] = False, 1.0
    unseen = windows.unseen(weight, fixed) + windows.alike(weight, fixed)
    if not slid.any():
        return Moving(pose, None, 0.0, unseen)
    share = float(windows.area[slid].sum() / windows.area.sum())
    return Moving(at, Places(windows.centre, weight, patches.width), share, unseen)


def clearly_moved(windows: Windows, away: Float) -> Bool:
    """(k,) patches of groups that contradict the rest, one of them by far more than any does by chance.

    Args:
        away: (k,) standard deviations from what the rest agrees on.
    """
    some = np.flatnonzero(away > _DEVIATIONS_OF_GROUP)
    found = np.zeros(len(away), dtype=bool)
    if len(some):
        near = windows.near(_GROUP_WIDTHS)[some][:, some]
        number = connected_components(near, directed=False)[1]
        most = np.zeros(number.max() + 1)
        np.maximum.at(most, number, away[some])
        found[some] = (most > DEVIATIONS)[number]
    return found


@dataclass(frozen=True)
class _Scale:
    """Windows of one radius about each patch: the motion along the surface that each asks for.

    ``information`` (k, 2, 2), offset and tilts taken out, and its ``inverse`` where it is no noise; ``score`` (k, 2) at
    no motion; ``along`` (k, 2, 6) the window's motion by that of the whole; ``enough`` patches are in it.
    """

    information: Float
    inverse: Float
    score: Float
    along: Float
    enough: Bool

    def squared(self, motion: Float) -> Float:
        """(k,) squared distance of what windows ask for from a motion (6,), in the variances that their points give."""
        left = self.score + np.einsum("kij,kj->ki", self.information, self.along @ motion)
        found = np.einsum("ki,kij,kj->k", left, self.inverse, left)
        return np.where(self.enough, found, 0.0)

    def by_chance(self, motion: Float) -> float:
        """What ``squared`` is of by chance, by a standard error: noise, plants and bends, as most windows show it."""
        if not self.enough.any():
            return 1.0
        least = _MIN_DEVIATION_M**2 / float(np.median(np.trace(self.inverse[self.enough], axis1=1, axis2=2)) / 2)
        return max(float(np.quantile(self.squared(motion)[self.enough], _CHANCE_QUANTILE)) / _CHANCE_VALUE, least)


@dataclass(frozen=True)
class Windows:
    """Patches with their equations ``matrix`` (k, 6, 6) and ``vector`` (k, 6) in units of their noise.

    ``centre`` and ``normal`` (k, 3; its length is the area) are theirs; ``width`` and ``radius``, by which turns are
    scaled, are metres. Windows are drawn about each patch.
    """

    centre: Float
    normal: Float
    area: Float
    matrix: Float
    vector: Float
    width: float
    radius: float

    @classmethod
    def of(cls, system: Equations, patches: Patches, pose: Pose, radius: float) -> Windows | None:
        """Of patches that have enough pairs; None of too few of them."""
        some = np.flatnonzero(system.pairs >= _MIN_PATCH_PAIRS)
        if len(some) < _MIN_PATCHES:
            return None
        noise = np.maximum(system.rest[some], float(np.median(system.rest[some])) / 4)
        share = patches.area[some] / np.maximum(noise, 1e-12)
        share /= share.mean()
        matrix, vector = share[:, None, None] * system.matrix[some], share[:, None] * system.vector[some]
        centre, normal = pose.apply(patches.centre[some]), patches.normal[some] @ pose.rotation.T
        normal = normal * np.where(normal[:, 2:] < 0, -1.0, 1.0) * patches.area[some, None]
        return cls(centre, normal, patches.area[some], matrix, vector, patches.width, radius)

    @cached_property
    def _pairs(self) -> tuple[Float, NDArray[np.int64]]:
        """Distances (p,) and numbers (p, 2) of patches that lie in one window."""
        pairs = cKDTree(self.centre).query_pairs(WINDOW_RADII_WIDTHS[-1] * self.width, output_type="ndarray")
        away = self.centre[pairs[:, 0]] - self.centre[pairs[:, 1]]
        return np.asarray(np.sqrt(np.einsum("ij,ij->i", away, away))), pairs

    def near(self, widths: float) -> csr_array:
        """(k, k) one for the patches of the window of a radius about each."""
        k, (away, pairs) = len(self.centre), self._pairs
        first, second = pairs[away <= widths * self.width].T
        own = np.arange(k)
        rows, columns = np.concatenate([first, second, own]), np.concatenate([second, first, own])
        return csr_array((np.ones(len(rows)), (rows, columns)), shape=(k, k))

    def scale(self, widths: float, among: Float) -> _Scale:
        """Windows of one radius, of whose patches those with a weight in ``among`` (k,) count by it."""
        k, reach = len(self.centre), widths * self.width
        near = csr_array(self.near(widths) @ diags_array(among))
        frame = _frames(near @ self.normal + 1e-9 * self.normal)
        # parameters of a window: its shift and its turn about its own middle, in its own axes
        change = np.zeros((k, 6, 6))
        change[:, :3, :3] = frame * (self.radius / reach)
        change[:, 3:, :3] = _cross(self.centre) @ frame / reach
        change[:, 3:, 3:] = frame
        turned = change.transpose(0, 2, 1)
        whole = turned @ (near @ self.matrix.reshape(-1, 36)).reshape(-1, 6, 6) @ change
        pull = (turned @ (near @ self.vector)[:, :, None])[:, :, 0]
        # the offset and both tilts are left free: plants and bends of a survey make them, and they slide nothing
        slide, free = [3, 4], [5, 0, 1]
        cross = whole[:, slide][:, :, free]
        size = np.trace(whole, axis1=1, axis2=2)[:, None, None]
        inner = whole[:, free][:, :, free] + (1e-6 * size + 1e-12) * np.eye(3)
        gain = np.linalg.solve(inner, cross.transpose(0, 2, 1)).transpose(0, 2, 1)
        information = whole[:, slide][:, :, slide] - gain @ cross.transpose(0, 2, 1)
        score = pull[:, slide] - (gain @ pull[:, free][:, :, None])[:, :, 0]
        along = np.concatenate([-_cross(self.centre) / self.radius, np.broadcast_to(np.eye(3), (k, 3, 3))], axis=2)
        values, axes = np.linalg.eigh((information + information.transpose(0, 2, 1)) / 2)
        enough = np.asarray(near.sum(axis=1)).ravel() >= _MIN_WINDOW_PATCHES
        least = _MIN_INFORMATION_RATIO * float(np.median(values[enough])) if enough.any() else 0.0
        inverse = axes @ (axes / np.maximum(values, max(least, 1e-12))[:, None, :]).transpose(0, 2, 1)
        return _Scale(information, inverse, score, frame.transpose(0, 2, 1)[:, :2] @ along, enough)

    def solved(self, weight: Float, fixed: Float) -> Float:
        """(6,) motion in the ``fixed`` directions (6, r) that suits the patches best by ``weight`` (k,)."""
        if not fixed.shape[1]:
            return np.zeros(6)
        matrix = fixed.T @ np.einsum("k,kij->ij", weight, self.matrix) @ fixed
        matrix += 1e-6 * max(float(np.trace(matrix)), 1e-12) * np.eye(len(matrix))
        return np.asarray(-fixed @ np.linalg.solve(matrix, fixed.T @ (weight @ self.vector)))

    def unseen(self, weight: Float, fixed: Float) -> Float:
        """(6, 6) covariance of ``solved`` if one of the widest windows slid by as much as is not seen.

        The pull of such a slide grows with the window's share of the surface, its standard error falls with the root
        of it: widest windows pull most of all that nobody sees. By how much it slid is uniform up to what is seen.
        """
        scale = self.scale(WINDOW_RADII_WIDTHS[-1], weight)
        if not scale.enough.any():
            return np.zeros((6, 6))
        spread = scale.inverse[scale.enough] * scale.by_chance(self.solved(weight, fixed))
        matrix = (weight[:, None, None] * (fixed.T @ self.matrix)).reshape(len(weight), -1)
        inside = (self.near(WINDOW_RADII_WIDTHS[-1]) @ matrix).reshape(len(weight), -1, 6)[scale.enough]
        shift = scale.along[scale.enough][:, :, 3:].transpose(0, 2, 1)
        whole = matrix.sum(axis=0).reshape(-1, 6) @ fixed
        whole += 1e-6 * np.trace(whole) * np.eye(len(whole))
        pull = np.linalg.solve(whole, inside[:, :, 3:] @ shift)
        found = (pull @ spread @ pull.transpose(0, 2, 1)).mean(axis=0)
        return np.asarray(DEVIATIONS**2 / 3 * fixed @ found @ fixed.T)

    def alike(self, weight: Float, fixed: Float) -> Float:
        """(6, 6) covariance of ``solved`` by what neighbours have in common, more than by patches that err alone.

        One of the widest windows after the other is left out (a jackknife; Efron and Stein 1981), against one patch
        after the other. Each patch lies in as many windows as there are patches in one, by which the sum is divided.
        """
        left = (weight[:, None] * (self.vector + self.matrix @ self.solved(weight, fixed))) @ fixed
        matrices = weight[:, None, None] * (fixed.T @ self.matrix @ fixed)
        size = matrices.shape[1]
        whole = matrices.sum(axis=0)
        found = []
        for near in (self.near(WINDOW_RADII_WIDTHS[-1]), self.near(0.0)):
            without = whole - (near @ matrices.reshape(-1, size**2)).reshape(-1, size, size)
            without += 1e-3 * np.diag(np.diag(whole))
            steps = np.linalg.solve(without, (near @ left)[:, :, None])[:, :, 0]
            found.append(steps.T @ steps / float(near.sum(axis=1).mean()))
        more = max(float(np.trace(found[0]) / max(np.trace(found[1]), 1e-300)) - 1.0, 0.0)
        return np.asarray(more * fixed @ found[1] @ fixed.T)


def _frames(normal: Float) -> Float:
    """(k, 3, 3) axes in columns: two along the surface, and its normal."""
    up = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    aside = np.where(np.abs(up[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(aside, up)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(up, first), up], axis=2)


def _cross(vectors: Float) -> Float:
    """(k, 3, 3) matrices that take the cross product of ``vectors`` (k, 3) with another one."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    return np.stack([none, -z, y, z, none, -x, -y, x, none], axis=1).reshape(-1, 3, 3)


@dataclass(frozen=True)
class Consensus:
    """The ``motion`` (6,) that most windows agree on, and how many standard deviations those about each patch are
    ``away`` (k,) from it.
    """

    motion: Float
    away: Float


def consensus(windows: Windows, fixed: Float) -> Consensus:
    """The motion in the ``fixed`` directions (6, r) that most windows agree on.

    It begins where the sum of the windows' distances, not of their squares, is least: nearly half of them may move.
    Wide windows, which show less, then hold what the narrow ones agree on, or their margins would cost what rests.
    """
    everything = np.ones(len(windows.area))
    narrow = windows.scale(WINDOW_RADII_WIDTHS[0], everything)
    scales: tuple[_Scale, ...] = (narrow, windows.scale(WINDOW_RADII_WIDTHS[1], everything))
    motion = np.zeros(6)
    for _ in range(_START_ROUNDS):
        motion = windows.solved(1.0 / np.maximum(_away(scales, motion), 1.0), fixed)
    motion = _settled(windows, scales, motion, fixed)
    among = _tukey(_away((narrow,), motion), _CUTOFF)
    scales = (narrow, *(windows.scale(widths, among) for widths in WINDOW_RADII_WIDTHS[1:]))
    motion = _settled(windows, scales, motion, fixed)
    return Consensus(motion, _away(scales, motion))


def _settled(windows: Windows, scales: tuple[_Scale, ...], motion: Float, fixed: Float) -> Float:
    weight = np.ones(len(windows.area))
    for number in range(_ROUNDS):
        before, weight = weight, _tukey(_away(scales, motion), _CUTOFF * max(1.0, 1.8 - number / 5))
        motion = windows.solved(weight, fixed)
        if number > 4 and float(np.abs(weight - before).max()) < 1e-3:
            break
    return motion


def _tukey(away: Float, cutoff: float) -> Float:
    return np.asarray(np.maximum(1.0 - (away / cutoff) ** 2, 0.0) ** 2)


def _away(scales: tuple[_Scale, ...], motion: Float) -> Float:
    """(k,) how many standard deviations the windows about a patch are from a motion (6,): of those of all radii most.

    The deviations are those that windows show by chance.
    """
    most: NDArray[np.float64] = np.zeros(len(scales[0].score))
    for scale in scales:
        most = np.maximum(most, scale.squared(motion) / max(scale.by_chance(motion), 1e-12))
    return np.asarray(np.sqrt(most))
