"""One piece of ground: how far it has moved along its surface, and whether its relief is still the same.

Windows are discs, and those over a bulge or a hollow hold its edge too. Here the nodes of a piece alone are laid on
each other. The smooth part of what changed is taken off first, once along the normal and once upright: a bulge is not
what holds a surface along itself, and relief that it lifts straight up moves along the slope, more in its middle than
at its edge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float, Index
from .errors import common_ratio, covariances
from .frame import Frame
from .ground_by_boxes import GroundByBoxes
from .kernels import sampled
from .least_squares import Fit, Region, fit_motion
from .measure import MIN_INFORMATION, MIN_SEEN_SHARE
from .start import NODES, best_shifts, relief
from .surface import NODE_M, gridded
from .windows import Search

_SMOOTH_M = 0.75
"""Standard deviation of what is taken off as smooth change; relief of a metre keeps 0.99 of its height."""
_AROUND_FROM_M, _AROUND_TO_M = 0.75, 6.0
"""Where ground around a piece lies that its relief is compared with."""
_MAX_WIDTH_M = 50.0  # of what is fitted of one piece, so that memory stays bounded
_MIN_BLOCK_M, _MAX_BLOCK_M, _BLOCKS = 0.5, 1.0, 24  # side of the blocks that err alike; aimed at: so many of them
_MIN_BLOCKS = 4
_MIN_BLOCK_SHARE = 0.3  # of the usual number of nodes, for a block to count
_MEDIAN_ERROR, _MIN_SPREAD = 1.2533, 0.02  # of a median by that of a mean; of blocks that are by chance alike
_DETAIL_KERNELS, _MIN_DETAIL_M = 4.0, 0.3
"""Standard deviation of the local mean that is taken off the rises whose likeness is asked for, in the kernel's."""
_CLEARLY_ERRORS = 2.0
_CORE_DEPTH = 0.4  # of the largest distance to a piece's edge: at an edge of what sank no relief is the same
_HALO_M = 1.0
_MIN_UPRIGHT = 0.2  # cosine of the slope, above which a smooth change may be one of heights
_MIN_START_M, _MIN_CORRELATION, _MIN_GAIN = 0.15, 0.3, 0.9  # of a start from correlation, as for windows

NumberAt = Callable[[Float], Index]
"""Of places (n, 2): 1 in the piece, 0 on other ground, -1 where something else changed."""


@dataclass(frozen=True)
class Likeness:
    """How alike the relief of both surveys is: 1 for the same without noise, 0 for none in common; standard error."""

    value: float
    error: float


@dataclass(frozen=True)
class GroundFit:
    """What relief says of a piece of ground.

    Attributes:
        motion: (2,) down the dip and across it, metres; None where relief does not hold it in both directions.
        covariance: (2, 2) of it, without the registration's error, m².
        own, around: likeness of the relief within and around; None where too little is seen.
        rise: (2,) mean rise of the surface over its facet's plane along both axes.
        axes: (3, 3) down the dip, across and normal, row by row in the map's coordinates.
        place: (3,) its middle.
        seen: share of it that both surveys see.
    """

    motion: Float | None
    covariance: Float | None
    own: Likeness | None
    around: Likeness | None
    rise: Float
    axes: Float
    place: Float
    seen: float


@dataclass(frozen=True)
class Gridded:
    """A piece and its surroundings in the plane of its facet.

    ``first`` and ``later`` (3, rows, columns) as ``surface.gridded``, the later without its smooth change; ``detail``
    (2, 2, rows, columns) the rises of both without their local mean; ``number`` (rows, columns) as ``NumberAt``;
    ``place`` (3,) the middle in the map; ``undone`` (2,) mean motion along the axes that was taken off with the change.
    """

    frame: Frame
    first: Float
    later: Float
    detail: Float
    number: Index
    place: Float
    undone: Float


def grid_piece(
    clouds: Sequence[GroundByBoxes],
    frame: Frame,
    bounds: tuple[float, float, float, float],
    number_at: NumberAt,
    search: Search,
) -> list[Gridded]:
    """The surfaces of both surveys under a piece within ``bounds`` (west, south, east, north); none without points.

    Twice: with the smooth change taken off along the normal, and upright.
    """
    reach = max(_AROUND_TO_M, search.limit / 2) + _HALO_M
    wide = _clipped(bounds)
    near = [cloud.within((wide[0] - reach, wide[1] - reach, wide[2] + reach, wide[3] + reach)) for cloud in clouds]
    if min(len(part) for part in near) < 3:
        return []
    flat = [frame.to_plane(part) for part in near]
    middle = np.array([(wide[0] + wide[2]) / 2, (wide[1] + wide[3]) / 2])
    inside = ((near[0][:, :2] >= wide[:2]) & (near[0][:, :2] <= wide[2:])).all(axis=1)
    if not inside.any():
        return []
    low, high = flat[0][inside, :2].min(axis=0) - reach, flat[0][inside, :2].max(axis=0) + reach
    shape = tuple(int(n) for n in np.ceil((high - low) / NODE_M) + 1)
    first, later = (gridded(part, low, (shape[0], shape[1]), search.kernel).values for part in flat)
    design = np.column_stack([np.ones(len(flat[0])), flat[0][:, :2]])
    plane = np.linalg.lstsq(design, flat[0][:, 2], rcond=None)[0]
    u, v = (low[k] + np.arange(shape[k]) * NODE_M for k in (0, 1))
    level = plane[0] + plane[1] * u[:, None] + plane[2] * v[None, :]
    above = np.where(np.isfinite(first[0]), first[0], level)
    nodes = np.stack([np.broadcast_to(u[:, None], shape), np.broadcast_to(v[None, :], shape), above], axis=-1)
    on_map = (nodes.reshape(-1, 3) @ frame.axes) + frame.origin
    number = number_at(on_map[:, :2]).reshape(shape)
    height = float(np.median(near[0][inside, 2]))
    place = np.append(middle, height)
    change = _smooth_change(first, later)
    still = later - np.stack([change, *np.gradient(change, NODE_M)])
    found = [Gridded(frame, first, still, _details(first, still, search.kernel), number, place, np.zeros(2))]
    own = (number == 1) & np.isfinite(first[0]) & np.isfinite(later[0])
    if frame.axes[2, 2] > _MIN_UPRIGHT and own.any():
        upright = frame.axes[:2, 2] / frame.axes[2, 2]  # motion along the axes for each metre along the normal
        at = (flat[1][:, :2] - low) / NODE_M
        lifted = ndimage.map_coordinates(change, at.T, order=1, mode="nearest")
        back = flat[1] - lifted[:, None] * np.append(upright, 1.0)
        lowered = gridded(back, low, (shape[0], shape[1]), search.kernel).values
        undone = upright * float(change[own].mean())
        found.append(Gridded(frame, first, lowered, _details(first, lowered, search.kernel), number, place, undone))
    return found


def _clipped(bounds: tuple[float, float, float, float]) -> Float:
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    middle = (low + high) / 2
    return np.concatenate(
        [np.maximum(low, middle - _MAX_WIDTH_M / 2), np.minimum(high, middle + _MAX_WIDTH_M / 2)]
    )  # fmt: skip


def _smooth_change(first: Float, later: Float) -> Float:
    """(rows, columns) what ``later`` differs smoothly from ``first``."""
    change = later[0] - first[0]
    known = np.isfinite(change)
    return _smoothed(np.where(known, change, 0.0), known)


def _smoothed(values: Float, known: Bool, width: float = _SMOOTH_M) -> Float:
    sigma = width / NODE_M
    weight = ndimage.gaussian_filter(known.astype(np.float64), sigma, mode="constant")
    smooth = ndimage.gaussian_filter(np.where(known, values, 0.0), sigma, mode="constant")
    return np.asarray(smooth / np.maximum(weight, 1e-9))


def _details(first: Float, later: Float, kernel: float) -> Float:
    """The rises (2, 2, rows, columns) of both without their local mean."""
    known = np.isfinite(first[0]) & np.isfinite(later[0])
    width = max(_DETAIL_KERNELS * kernel, _MIN_DETAIL_M)
    return np.stack(
        [np.stack([rise - _smoothed(rise, known, width) for rise in values[1:]]) for values in (first, later)]
    )


@dataclass(frozen=True)
class PieceFits:
    """What was fitted of a piece, before the errors: within and around it; ``blocks`` that were seen of it, and the
    motion (2,) that was ``undone`` with the change.
    """

    own: Fit | None
    around: Fit | None
    blocks: float
    undone: Float
    found: GroundFit


def fit_piece(pieces: Sequence[Gridded], search: Search) -> PieceFits:
    """The motion of a piece and of the ground around, and how alike their relief is in both surveys.

    Args:
        pieces: of ``grid_piece``; that counts whose relief is more alike in both surveys.
    """
    fits = [_fit_piece(piece, search) for piece in pieces]
    return max(fits, key=lambda one: -1.0 if one.found.own is None else one.found.own.value)


def _fit_piece(piece: Gridded, search: Search) -> PieceFits:
    within, around = piece.number == 1, _around(piece.number)
    regions = [_region(part, search.stride) for part in (within, around)]
    fits = [None if region is None else _fit(piece, *region, search) for region in regions]
    alike = [
        None if region is None else _likeness(piece, *region, fit) for region, fit in zip(regions, fits, strict=True)
    ]
    core = _region(_core(within), search.stride)
    alike[0] = _clearly_more(alike[0], None if core is None else _likeness(piece, *core, fits[0]))
    held = within & np.isfinite(piece.first[0]) & np.isfinite(piece.later[0])
    nodes = int(np.count_nonzero(within))
    rise = piece.first[1:, held].mean(axis=1) if held.any() else np.zeros(2)
    seen = float(np.count_nonzero(held) / nodes) if nodes else 0.0
    own, region = fits[0], regions[0]
    blocks = 0.0 if own is None or region is None else region[0].blocks * own.seen
    found = GroundFit(None, None, alike[0], alike[1], rise, piece.frame.axes, piece.place, seen)
    return PieceFits(own, fits[1], blocks, piece.undone, found)


def with_errors(pieces: Sequence[PieceFits]) -> list[GroundFit]:
    """Pieces with their motions and errors, made steadier by what all fits have in common."""
    common = common_ratio([fit for piece in pieces for fit in (piece.own, piece.around) if fit is not None])
    found = []
    for piece in pieces:
        own = piece.own
        if own is None or not own.converged or own.information[0] < MIN_INFORMATION or own.seen < MIN_SEEN_SHARE:
            found.append(piece.found)
            continue
        covariance = covariances([own], [piece.blocks], common)[0][:2, :2]
        found.append(replace(piece.found, motion=own.motion[:2] + piece.undone, covariance=covariance))
    return found


def _clearly_more(whole: Likeness | None, core: Likeness | None) -> Likeness | None:
    """The likeness of the core where it is clearly larger than that of the whole, else that."""
    if whole is None or core is None:
        return whole
    clearly = core.value - whole.value > _CLEARLY_ERRORS * math.hypot(core.error, whole.error)
    return core if clearly else whole


def _core(within: Bool) -> Bool:
    depth = ndimage.distance_transform_edt(np.pad(within, 1))[1:-1, 1:-1]
    return np.asarray(within & (depth >= _CORE_DEPTH * depth.max(initial=0.0)))


def _around(number: Index) -> Bool:
    distance = ndimage.distance_transform_edt(number != 1) * NODE_M
    return np.asarray((number == 0) & (distance >= _AROUND_FROM_M) & (distance <= _AROUND_TO_M))


def _region(chosen: Bool, stride: int) -> tuple[Region, tuple[int, int]] | None:
    """Every ``stride``-th of the chosen nodes, and their middle; None where they are too few."""
    at = np.argwhere(chosen)
    at = at[((at % stride) == 0).all(axis=1)]
    if not len(at):
        return None
    side = float(np.clip(math.sqrt(len(at) / _BLOCKS) * stride * NODE_M, _MIN_BLOCK_M, _MAX_BLOCK_M))
    centre = np.rint(at.mean(axis=0)).astype(np.int64)
    region = Region.of_nodes(at[:, 0] - centre[0], at[:, 1] - centre[1], side)
    return None if region.blocks < _MIN_BLOCKS else (region, (int(centre[0]), int(centre[1])))


def _fit(piece: Gridded, region: Region, middle: tuple[int, int], search: Search) -> Fit | None:
    """From no motion, or from the shift of best correlation where that leads to a clearly better agreement."""
    still = fit_motion(piece.first, piece.later, region, middle, np.zeros(2), search.limit)
    radius = max(float(np.abs(region.offsets).max()), 1.0)
    coarse = relief(piece.first), relief(piece.later)
    shifts, correlation = best_shifts(*coarse, np.array([middle]) // NODES, radius, search.limit)
    known = still if isinstance(still, Fit) else None
    if correlation[0] < _MIN_CORRELATION or np.hypot(*shifts[0]) < _MIN_START_M:
        return known
    moved = fit_motion(piece.first, piece.later, region, middle, shifts[0], search.limit)
    if not isinstance(moved, Fit) or not moved.converged:
        return known
    return moved if known is None or not known.converged or moved.scale < _MIN_GAIN * known.scale else known


def _likeness(piece: Gridded, region: Region, middle: tuple[int, int], fit: Fit | None) -> Likeness | None:
    """Of the rises, at rest or after the motion that was found, whichever is larger."""
    found = [_alike(piece.detail, region, middle, np.zeros(2))]
    if fit is not None and fit.converged:
        found.append(_alike(piece.detail, region, middle, fit.motion[:2]))
    known = [one for one in found if one is not None]
    return max(known, key=lambda one: one.value) if known else None


def _alike(detail: Float, region: Region, middle: tuple[int, int], motion: Float) -> Likeness | None:
    """Products of both surveys' rises by the mean of their squares: the median of blocks, as a step or an edge of what
    changed is in some of them.
    """
    rises = []
    for values, shift in zip(detail, (-motion / 2 / NODE_M, motion / 2 / NODE_M), strict=True):
        whole = np.floor(shift).astype(np.int64)
        u, v = (float(part) for part in shift - whole)
        layers = np.concatenate([values, values[:1]])
        rises.append(
            sampled(layers, region.rows + middle[0] + whole[0], region.columns + middle[1] + whole[1], u, v)[:2]
        )
    seen = np.isfinite(rises[0]).all(axis=0) & np.isfinite(rises[1]).all(axis=0)
    block = region.block[seen]
    of = np.unique(block, return_inverse=True)[1]
    count = int(of.max(initial=-1)) + 1
    if count < _MIN_BLOCKS:
        return None
    first, later = (rise[:, seen] for rise in rises)
    nodes = np.bincount(of, minlength=count)
    both = np.bincount(of, (first * later).sum(axis=0), count)
    each = np.bincount(of, ((first**2).sum(axis=0) + (later**2).sum(axis=0)) / 2, count)
    known = (nodes >= _MIN_BLOCK_SHARE * np.median(nodes)) & (each > 0)
    if np.count_nonzero(known) < _MIN_BLOCKS:
        return None
    ratio = both[known] / each[known]
    value = float(np.median(ratio))
    spread = 1.4826 * float(np.median(np.abs(ratio - value)))
    return Likeness(value, _MEDIAN_ERROR * max(spread, _MIN_SPREAD) / math.sqrt(len(ratio)))
