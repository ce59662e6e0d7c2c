"""Windows of patches of a surface: the motion along the surface that each asks for, and the one that most agree on.

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
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float, Index
from ..geometry.pose import Pose
from .surface_patches import Equations, Patches

WINDOW_RADII_WIDTHS = (2.5, 4.0, 6.0)  # of patches
_MIN_PATCHES, _MIN_PATCH_PAIRS, _MIN_WINDOW_PATCHES = 60, 12, 5
ALONG, FREE = (3, 4), (5, 0, 1)  # of a window's motion: along the surface; offset and tilts
_CUTOFF = 4.0  # standard deviations of a window's motion from which it has no weight
_START_ROUNDS, _ROUNDS = 12, 20
_CHANCE_QUANTILE, _CHANCE_VALUE = 0.3, 0.7133  # of the square of two normal numbers; up to half of the windows may move
_MIN_INFORMATION_RATIO = 0.2  # of the median window's, below which it is noise
_MIN_DEVIATION_M = 2e-4  # of a window's motion; no two surveys agree better


@dataclass(frozen=True)
class Slides:
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

    def chosen(self, some: Index) -> Windows:
        """Of the patches with the numbers ``some`` alone."""
        centre, normal, area, matrix, vector = (
            one[some] for one in (self.centre, self.normal, self.area, self.matrix, self.vector)
        )
        return Windows(centre, normal, area, matrix, vector, self.width, self.radius)

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

    def scale(self, widths: float, among: Float) -> Slides:
        """Windows of one radius, of whose patches those with a weight in ``among`` (k,) count by it."""
        k, reach = len(self.centre), widths * self.width
        near = csr_array(self.near(widths) @ diags_array(among))
        frame = frames(near @ self.normal + 1e-9 * self.normal)
        change = changes(frame, self.centre, self.radius, reach)
        turned = change.transpose(0, 2, 1)
        whole = turned @ (near @ self.matrix.reshape(-1, 36)).reshape(-1, 6, 6) @ change
        pull = (turned @ (near @ self.vector)[:, :, None])[:, :, 0]
        # the offset and both tilts are left free: plants and bends of a survey make them, and they slide nothing
        slide, free = list(ALONG), list(FREE)
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
        return Slides(information, inverse, score, frame.transpose(0, 2, 1)[:, :2] @ along, enough)

    def solved(self, weight: Float, fixed: Float) -> Float:
        """(6,) motion in the ``fixed`` directions (6, r) that suits the patches best by ``weight`` (k,)."""
        if not fixed.shape[1]:
            return np.zeros(6)
        matrix = fixed.T @ np.einsum("k,kij->ij", weight, self.matrix) @ fixed
        matrix += 1e-6 * max(float(np.trace(matrix)), 1e-12) * np.eye(len(matrix))
        return np.asarray(-fixed @ np.linalg.solve(matrix, fixed.T @ (weight @ self.vector)))


def changes(frame: Float, centre: Float, radius: float, reach: float) -> Float:
    """(k, 6, 6) from a turn about a ``centre`` (k, 3), by a length ``reach`` (m), and a shift, both in the axes of a
    ``frame`` (k, 3, 3), to those of the whole, of which turns are scaled by a ``radius`` (m).
    """
    change = np.zeros((len(centre), 6, 6))
    change[:, :3, :3] = frame * (radius / reach)
    change[:, 3:, :3] = _cross(centre) @ frame / reach
    change[:, 3:, 3:] = frame
    return change


def frames(normal: Float) -> Float:
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
    scales: tuple[Slides, ...] = (narrow, windows.scale(WINDOW_RADII_WIDTHS[1], everything))
    motion = np.zeros(6)
    for _ in range(_START_ROUNDS):
        motion = windows.solved(1.0 / np.maximum(_away(scales, motion), 1.0), fixed)
    motion = _settled(windows, scales, motion, fixed)
    among = _tukey(_away((narrow,), motion), _CUTOFF)
    scales = (narrow, *(windows.scale(widths, among) for widths in WINDOW_RADII_WIDTHS[1:]))
    motion = _settled(windows, scales, motion, fixed)
    return Consensus(motion, _away(scales, motion))


def _settled(windows: Windows, scales: tuple[Slides, ...], motion: Float, fixed: Float) -> Float:
    weight = np.ones(len(windows.area))
    for number in range(_ROUNDS):
        before, weight = weight, _tukey(_away(scales, motion), _CUTOFF * max(1.0, 1.8 - number / 5))
        motion = windows.solved(weight, fixed)
        if number > 4 and float(np.abs(weight - before).max()) < 1e-3:
            break
    return motion


def _tukey(away: Float, cutoff: float) -> Float:
    return np.asarray(np.maximum(1.0 - (away / cutoff) ** 2, 0.0) ** 2)


def _away(scales: tuple[Slides, ...], motion: Float) -> Float:
    """(k,) how many standard deviations the windows about a patch are from a motion (6,): of those of all radii most.

    The deviations are those that windows show by chance.
    """
    most: NDArray[np.float64] = np.zeros(len(scales[0].score))
    for scale in scales:
        most = np.maximum(most, scale.squared(motion) / max(scale.by_chance(motion), 1e-12))
    return np.asarray(np.sqrt(most))
