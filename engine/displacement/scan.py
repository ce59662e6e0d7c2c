"""Where windows move together: what they say is summed over discs of growing size, and the largest sums are sought.

A window's motion is a mean over its ground, weighted by its information (the inverse of its covariance). Information
times motion, its score, is therefore a plain sum over the ground, and scores of windows may be added. Windows that
overlap share ground and err alike: the covariance of a sum counts each pair by the share that its discs have in common.
A sum in its standard errors is chi-squared with two degrees of freedom where nothing moves, whatever lies in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float, Index
from ..statistics.mask_sums import mask_sums
from .frame import Frame
from .vectors import Vectors, squared_length

_NARROW_REACH, _WIDE_REACHES = (0.55,), (0.0, 0.5, 1.0, 2.0, 4.0)
"""Radii of the discs from whose windows sums are made, in widths of these windows; 0 is a window by itself."""
_SPACINGS, _TRIALS = (0.0, 0.23, 0.45, 0.68, 0.91, 1.36), (0.0, 0.7, 1.7, 2.9, 3.3, 3.5)
"""Independent tests that all sums around a window are worth, by the windows' distance in widths of the narrow ones.
Drawn by lot (1,600 still maps each): how often the largest sum exceeds 16, in times that a single window does."""
_LEAST_COSINE = 0.1  # of a slope, below which it is taken as so steep


@dataclass(frozen=True)
class Peak:
    """A sum that stands out.

    Attributes:
        statistic: squared motion along the surface in standard errors.
        motion: (2,) along the axes of its facet, metres; of all ground of its windows, so that edges dilute it.
        window: number of the window in its middle.
        facet: its number.
        radius: of the ground of its windows, metres.
    """

    statistic: float
    motion: Float
    window: int
    facet: int
    radius: float


@dataclass(frozen=True)
class _Sums:
    """Sums around each of the windows ``number`` (n,): ``statistic`` (n,) and ``motion`` (n, 2), over ``reach`` metres;
    the windows' ``width``, metres.
    """

    number: Index
    statistic: Float
    motion: Float
    reach: float
    width: float


@dataclass(frozen=True)
class Layout:
    """Windows on the map: ``cells`` (n, 2) columns and rows, ``facet`` (n,), ``frames`` of facets, ``spacing`` (m)."""

    cells: Index
    facet: Index
    frames: tuple[Frame, ...]
    spacing: float


def trials_of(layout: Layout, windows: Bool, width: float) -> float:
    """Independent tests that a scan of the ``windows`` (n,) is worth, of which the narrow ones are ``width`` wide."""
    total = 0.0
    for number, frame in enumerate(layout.frames):
        cosine = max(abs(float(frame.axes[2, 2])), _LEAST_COSINE)
        each = float(np.interp(layout.spacing / np.sqrt(cosine) / width, _SPACINGS, _TRIALS))
        total += each * np.count_nonzero(windows & (layout.facet == number))
    return total


def map_probability(statistic: float, tests: float) -> float:
    """That still ground shows such a sum anywhere, among so many independent ``tests``."""
    return float(-np.expm1(-tests * np.exp(-statistic / 2)))


def peaks(
    widths: Sequence[Vectors], left: Sequence[Bool], layout: Layout, error: Float, least: float
) -> Iterator[Peak]:
    """The sums of at least ``least``, largest first; none has a window near one that was given before.

    Args:
        widths: windows of each width, narrow ones first, without the registration's error.
        left: (n,) of each width, those that may be used. A peak's own window is taken out; so may others be.
        error: (n, 3, 3) covariance of the registration at the windows, m².
    """
    found = []
    for number, frame in enumerate(layout.frames):
        mine = layout.facet == number
        for order, (vectors, usable) in enumerate(zip(widths, left, strict=True)):
            use = usable & mine
            if use.any():
                narrow = order + 1 < len(widths)
                found += [(number, sums) for sums in _sums(vectors, use, frame, layout, error, narrow=narrow)]
    before = [usable.copy() for usable in left]
    while True:
        best: tuple[int, _Sums, int] | None = None
        for facet, sums in found:
            apart = _apart(sums, before, left, widths, layout)
            value = np.where(apart, sums.statistic, 0.0)
            at = int(np.argmax(value))
            if value[at] >= least and (best is None or value[at] > best[1].statistic[best[2]]):
                best = facet, sums, at
        if best is None:
            return
        facet, sums, at = best
        window = int(sums.number[at])
        yield Peak(float(sums.statistic[at]), sums.motion[at], window, facet, sums.width / 2 + sums.reach)
        left[_order_of(sums, widths)][window] = False


def _order_of(sums: _Sums, widths: Sequence[Vectors]) -> int:
    return next(k for k, vectors in enumerate(widths) if vectors.width[0] == sums.width)


def _apart(
    sums: _Sums, before: Sequence[Bool], left: Sequence[Bool], widths: Sequence[Vectors], layout: Layout
) -> Bool:
    """Which sums have none of the windows that were taken out since they were made."""
    mine = _order_of(sums, widths)
    out = before[mine] & ~left[mine]
    if not out.any():
        return np.ones(len(sums.number), dtype=bool)
    frame = layout.frames[int(layout.facet[sums.number[0]])]
    flat = frame.to_plane(widths[mine].places)[:, :2]
    distance = cKDTree(flat[out]).query(flat[sums.number])[0]
    return np.asarray(distance > sums.reach)


def _sums(vectors: Vectors, use: Bool, frame: Frame, layout: Layout, error: Float, *, narrow: bool) -> Iterator[_Sums]:
    """Sums over discs of each size of the windows ``use`` (n,) of one facet and width."""
    chosen = np.flatnonzero(use)
    cells = layout.cells[chosen]
    low = cells.min(axis=0)
    at = tuple((cells - low).T)
    shape = tuple((cells - low).max(axis=0) + 1)
    inverse = np.linalg.inv(vectors.in_plane_covariance[chosen][:, :2, :2])
    information, score = np.zeros((*shape, 3)), np.zeros((*shape, 2))
    information[at] = inverse[:, (0, 0, 1), (0, 1, 1)]
    score[at] = np.einsum("nij,nj->ni", inverse, vectors.in_plane[chosen][:, :2])
    width = float(vectors.width[0])
    flat = frame.to_plane(vectors.places[chosen])[:, :2]
    widest = float(np.ptp(flat, axis=0).max()) / 2
    registered = (frame.axes @ error[chosen] @ frame.axes.T)[:, :2, :2]
    for reach in (share * width for share in (_NARROW_REACH if narrow else _WIDE_REACHES)):
        if reach > max(widest, width):
            return
        disc = _disc(frame, layout.spacing, reach)
        total = mask_sums(score, disc)[at]
        weight = matrices_of(mask_sums(information, disc)[at])
        spread = matrices_of(_pair_sums(information, disc, frame, layout.spacing, width)[at])
        back = np.linalg.inv(weight)
        motion = np.einsum("nij,nj->ni", back, total)
        statistic = squared_length(motion, back @ spread @ back + registered)
        yield _Sums(chosen, statistic, motion, reach, width)


def _disc(frame: Frame, spacing: float, reach: float) -> Bool:
    """(2 k + 1, 2 k + 1) which of the windows around one lie within ``reach`` metres along the surface."""
    count = int(reach / spacing)  # along the surface windows are farther apart than on the map
    offsets = np.stack(np.meshgrid(*2 * [np.arange(-count, count + 1)], indexing="ij"), axis=-1)
    return np.asarray(_distance(frame, offsets.astype(np.float64) * spacing) <= reach + 1e-9)


def _distance(frame: Frame, offset: Float) -> Float:
    """Along the surface, of offsets (..., 2) on the map, metres."""
    normal = frame.axes[2]
    rise = -(offset @ normal[:2]) / max(abs(float(normal[2])), _LEAST_COSINE)
    return np.asarray(np.sqrt((offset**2).sum(axis=-1) + rise**2))


def _pair_sums(information: Float, disc: Bool, frame: Frame, spacing: float, width: float) -> Float:
    """Sums over all pairs of windows of the disc around each place: their information by what they have in common."""
    total = mask_sums(information, disc)  # each with itself
    known = information[..., 0] > 0
    reach = int(width / spacing)
    for column in range(reach + 1):
        for row in range(-reach if column else 1, reach + 1):
            share = float(common_share(_distance(frame, np.array([column, row]) * spacing) / width))
            both = _overlap(disc, column, row)
            if share <= 0 or not both.any():
                continue
            here, there = _pairs(information.shape, column, row)
            pair = np.zeros_like(information)
            held = known[here] & known[there]
            pair[here] = np.where(held[..., None], share * (information[here] + information[there]), 0.0)
            total = total + mask_sums(pair, both)
    return np.asarray(total)


def _overlap(disc: Bool, column: int, row: int) -> Bool:
    """Which places of the disc have the one so many columns and rows farther in it, too."""
    both = np.zeros_like(disc)
    if column < disc.shape[0] and abs(row) < disc.shape[1]:
        here, there = _pairs(disc.shape, column, row)
        both[here] = disc[here] & disc[there]
    return both


def _pairs(shape: tuple[int, ...], column: int, row: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of all places that have one so many columns and rows farther, and of these."""
    columns, rows = max(shape[0] - column, 0), max(shape[1] - abs(row), 0)
    first, second = max(-row, 0), max(row, 0)
    return (
        (slice(0, columns), slice(first, first + rows)),
        (slice(column, column + columns), slice(second, second + rows)),
    )


def common_share(distance: Float | float) -> Float:
    """Share of a disc of diameter 1 that one at this distance (any shape) has in common with it."""
    near = np.minimum(distance, 1.0)
    return np.asarray(2.0 / np.pi * (np.arccos(near) - near * np.sqrt(1.0 - near**2)))


def matrices_of(values: Float) -> Float:
    """(n, 2, 2) symmetric matrices from (n, 3) their parts."""
    return values[:, [[0, 1], [1, 2]]]
