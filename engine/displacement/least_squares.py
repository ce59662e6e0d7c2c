"""Surface-to-surface least squares: the motion that lays one gridded surface on another over a region.

The surfaces are moved against each other by half the motion each, so that neither is preferred. The normal matrix takes
each gradient once from the one and once from the other survey: their noise is independent and does not count as relief.
(Lucas and Kanade 1981; Tukey's biweight; five unknowns, of which two are a growing tilt of the later surface.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core.arrays import Bool, Float, Index
from .kernels import Offset, block_sums, sampled_in_both, tukey, weighted
from .status import Status
from .surface import NODE_M

PARAMETERS = 5
"""Motion along both axes, and offset, tilt along and tilt across of the later surface."""
TUKEY_SCALES = 3.4
"""Residuals beyond so many standard deviations have no weight."""
BLOCK_SHARE = 0.4
"""Side of the blocks whose sums of residuals are taken as independent, in radii of the window (1 m for 2.5 m)."""
_MAX_ROUNDS = 15
_CONVERGED_M = 0.0005
_MAX_STEP_M = 0.2
_MIN_NODES = 60
_MIN_SCALE_M = 1e-4


@dataclass(frozen=True)
class Region:
    """The nodes over which one motion is sought.

    ``rows`` and ``columns`` (n,) count from the region's middle node; ``offsets`` (n, 2) are the same in metres, and
    ``block`` (n,) is the number of each node's block, ``blocks`` how many there are.
    """

    rows: Index
    columns: Index
    offsets: Float
    block: Index
    blocks: int

    @cached_property
    def places(self) -> Float:
        """(n, 3) 1 and the offsets."""
        return np.column_stack([np.ones(len(self.offsets)), self.offsets])

    @classmethod
    def of_nodes(cls, rows: Index, columns: Index, side: float) -> Region:
        """From the nodes' rows and columns, counted from the middle, and the side of a block in metres."""
        offsets: Float = np.column_stack([rows, columns]).astype(np.float64) * NODE_M
        place = np.floor(offsets / side + 0.5).astype(np.int64)
        place -= place.min(axis=0)
        key = place[:, 0] * (int(place[:, 1].max()) + 1) + place[:, 1]
        named, block = np.unique(key, return_inverse=True)
        return cls(rows, columns, offsets, block.reshape(-1).astype(np.int64), len(named))

    @classmethod
    def disc(cls, radius: float, stride: int) -> Region:
        """A disc of ``radius`` metres, of every ``stride``-th node."""
        reach = int(radius / NODE_M) // stride * stride
        rows, columns = (a.ravel() for a in np.mgrid[-reach : reach + 1 : stride, -reach : reach + 1 : stride])
        near = rows**2 + columns**2 <= (radius / NODE_M) ** 2
        return cls.of_nodes(rows[near].astype(np.int64), columns[near].astype(np.int64), BLOCK_SHARE * radius)


@dataclass(frozen=True)
class Fit:
    """What least squares say of one region.

    Attributes:
        motion: (3,) along both axes of the plane and along its normal, metres.
        bread: (5, 5) normal matrix, of which the gradients' part is from both surveys.
        meat: (5, 5) sum over the blocks of the squares of the summed residuals times gradients, by a jackknife.
        white: (5, 5) what ``meat`` would be, did the residuals of the nodes not depend on each other.
        bend: derivative of the weighted residual by the residual, mean over the mean weight.
        information: (2,) information on the weakest and the strongest direction along the surface, over its own
            standard error.
        seen: share of the region's nodes that both surveys see.
        scale: standard deviation of the residuals, metres.
        converged: whether the motion came to rest.
    """

    motion: Float
    bread: Float
    meat: Float
    white: Float
    bend: float
    information: Float
    seen: float
    scale: float
    converged: bool


@dataclass(frozen=True)
class Seen:
    """At the nodes that both surveys see, ``seen`` of the region's: height and rises (n, 3) of both, and ``place``
    (n, 3): 1 and the offsets.
    """

    seen: Bool
    before: Float
    after: Float
    place: Float

    @cached_property
    def residual(self) -> Float:
        """(n,) height of the later survey above the first one."""
        return self.after[:, 0] - self.before[:, 0]

    @property
    def first(self) -> Float:
        """(n, 2) rises of the first survey."""
        return self.before[:, 1:]

    @property
    def later(self) -> Float:
        """(n, 2) rises of the later survey."""
        return self.after[:, 1:]


def fit_motion(
    first: Float, later: Float, region: Region, middle: tuple[int, int], start: Float, limit: float
) -> Fit | Status:
    """The motion of ``later`` against ``first``, both (3, rows, columns) as ``GriddedSurface.values``.

    Args:
        middle: row and column of the region's middle.
        start: (2,) motion along the axes to begin with, metres.
        limit: motions beyond are not followed, metres.

    Returns:
        The reason where there is none: too little is seen by both, or nothing holds the surfaces along themselves.
    """
    motion = np.array(start, dtype=np.float64)
    plane, converged = None, False
    for _ in range(_MAX_ROUNDS):
        at = seen_by_both((first, later), region, middle, motion)
        if at is None:
            return Status.LITTLE_SEEN
        if plane is None:
            plane = _robust_plane(at)
        residual = at.residual - at.place @ plane
        weight = tukey(residual, TUKEY_SCALES * _scale(residual))
        jacobian, bread = _jacobian_and_bread(at, weight)
        gradient = jacobian.T @ (weight * at.residual)
        try:
            weakest = _weakest_information(bread)
        except np.linalg.LinAlgError:  # what is seen lies on one line, which holds no tilt across it
            return Status.LITTLE_SEEN
        if weakest <= 0:
            return Status.NO_RELIEF
        step = -np.linalg.solve(bread, gradient)
        plane = -step[2:]
        length = float(np.hypot(*step[:2]))
        motion = motion + step[:2] * min(1.0, _MAX_STEP_M / max(length, 1e-12))
        if length < _CONVERGED_M:
            converged = True
            break
        if float(np.hypot(*motion)) > limit:
            break
    assert at is not None
    assert plane is not None
    return _described(at, region, motion, plane, converged)


def seen_by_both(surfaces: tuple[Float, Float], region: Region, middle: tuple[int, int], motion: Float) -> Seen | None:
    """The region's nodes that both ``surfaces`` (3, rows, columns) know, the later one moved back by ``motion`` (2,).

    None where they are too few.
    """
    half = motion / 2 / NODE_M
    of_first, of_later = (_offset(middle, shift) for shift in (-half, half))
    seen, before, after, place = sampled_in_both(
        *surfaces, region.rows, region.columns, region.places, of_first, of_later
    )
    return None if len(before) < _MIN_NODES else Seen(seen, before, after, place)


def _offset(middle: tuple[int, int], shift: Float) -> Offset:
    whole = np.floor(shift)
    u, v = shift - whole
    return middle[0] + int(whole[0]), middle[1] + int(whole[1]), float(u), float(v)


def middle_of(values: Float) -> float:
    """As ``np.median`` of values (n,), n > 0, none of which is NaN."""
    half = len(values) // 2
    parted = np.partition(values, half)
    upper = float(parted[half])
    return upper if len(values) % 2 else (float(parted[:half].max()) + upper) / 2


def _scale(residual: Float) -> float:
    return max(1.4826 * middle_of(np.abs(residual)), _MIN_SCALE_M)


def _robust_plane(at: Seen) -> Float:
    """(3,) offset and tilts of the residuals by least squares, twice without what is far off."""
    plane = np.array([middle_of(at.residual), 0.0, 0.0])
    for _ in range(2):
        residual = at.residual - at.place @ plane
        by_weight = at.place * tukey(residual, TUKEY_SCALES * _scale(residual))[:, None]
        plane = np.linalg.lstsq(by_weight.T @ at.place, by_weight.T @ at.residual, rcond=None)[0]
    return np.asarray(plane)


def _jacobian_and_bread(at: Seen, weight: Float) -> tuple[Float, Float]:
    """(n, 5) derivatives of the residuals, and the normal matrix (5, 5)."""
    jacobian, by_weight, later = weighted(at.before, at.after, at.place, weight)
    bread = jacobian.T @ by_weight
    cross = at.first.T @ later
    bread[:2, :2] = (cross + cross.T) / 2
    return jacobian, bread


def _weakest_information(bread: Float) -> float:
    return float(np.linalg.eigvalsh(_along(bread))[0])


def _along(bread: Float) -> Float:
    """(2, 2) what ``bread`` says of the motion along the surface, offset and tilts unknown."""
    return np.asarray(bread[:2, :2] - bread[:2, 2:] @ np.linalg.solve(bread[2:, 2:], bread[2:, :2]))


def _described(at: Seen, region: Region, motion: Float, plane: Float, converged: bool) -> Fit:
    residual = at.residual - at.place @ plane
    scale = _scale(residual)
    weight = tukey(residual, TUKEY_SCALES * scale)
    jacobian, bread = _jacobian_and_bread(at, weight)
    block = region.block[at.seen]
    sums, parts = block_sums(at.before, at.after, jacobian, weight, residual, block, region.blocks)
    without = _without_each(sums, parts, bread)
    share = np.minimum(np.abs(residual) / (TUKEY_SCALES * scale), 1.0) ** 2
    slope = (1 - share) * (1 - 5 * share)
    return Fit(
        np.append(motion, plane[0]),
        bread,
        without.T @ without,
        jacobian.T @ (jacobian * (weight * residual)[:, None] ** 2),
        float(slope.mean() / max(weight.mean(), 1e-12)),
        _information(at, weight, block, region.blocks, bread),
        len(residual) / len(region.rows),
        scale,
        converged,
    )


def _information(at: Seen, weight: Float, block: Index, blocks: int, bread: Float) -> Float:
    """(2,) information on the weakest and the strongest direction over its standard error."""
    directions = np.linalg.eigh(_along(bread))[1]
    remove = np.linalg.solve(bread[2:, 2:], bread[2:, :2])
    first, later = at.first - at.place @ remove, at.later - at.place @ remove
    held = np.bincount(block, minlength=blocks) > 0
    found = np.zeros(2)
    for k, direction in enumerate(directions.T):
        parts = np.bincount(block, weight * (first @ direction) * (later @ direction), blocks)[held]
        error = float(np.std(parts)) * np.sqrt(len(parts))
        found[k] = parts.sum() / error if error > 0 else 0.0
    return found


def _without_each(sums: Float, parts: Float, bread: Float) -> Float:
    """(blocks, 5) ``sums`` of the blocks, as they would be did no block take part in its own fit: a jackknife.

    A block pulls the fit towards itself, so that its plain sum is too small; with twenty blocks and five unknowns the
    errors would be by a fifth too small (Bell and McCaffrey 2002, Survey Methodology 28).
    """
    return np.asarray(np.linalg.solve(bread - parts, sums[:, :, None])[:, :, 0] @ bread)
