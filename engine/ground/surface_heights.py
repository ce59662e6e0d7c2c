"""Heights of points over triangles through the ground's candidates, without stray returns below the ground.

A large cloud is worked on in tiles (``tiles``). What a tile must not decide for itself stands in ``Whole``: how
squares lie, how wide the seeds' windows are, the outline of the relief, and whether strays are looked for, which is a
matter of their share.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float
from ..geometry.columns import greatest, least, spans
from .densification import CANDIDATE_CELL_M, Triangles, densified, lowest_supported, seed_window_of
from .relief import SQUARE_M, Relief, relief
from .stray_low import MIN_REPORTED_SHARE, stray_below

SURFACE_CELL_M = 0.25
NEAR_RELIEF_M = 0.5
"""Points within this distance of the relief give seeds too."""
SLICE_M, CLOSE_SLICE_M, STRAY_ROUNDS = 0.1, 0.05, 3
"""Slices in which strays are looked for: of the slope, and of heights over the triangles, in so many rounds."""


@dataclass(frozen=True)
class Whole:
    """What parts of one cloud have in common.

    ``origin`` (2,) m is where all squares begin, ``window`` (m) the side of the seeds' windows, ``outline`` the relief
    that is taken off first; ``slope_strays`` says whether strays are taken out in slices of the slope, ``stray_rounds``
    how often over the triangles. Where these two are None, the points at hand decide by their share of strays.
    """

    origin: Float
    window: float
    outline: Relief | None = None
    slope_strays: bool | None = None
    stray_rounds: int | None = None

    @property
    def single(self) -> bool:
        """Returns are so few that the outline is followed closely, see ``Relief``."""
        return self.outline is not None and self.outline.single


@dataclass(frozen=True)
class Heights:
    """``height`` (n,) m over triangles, ``left`` (n,) the points that still take part, and the share of strays.

    ``slope_strays``, ``stray_rounds`` and ``single`` see ``Whole``.
    """

    height: Float
    left: Bool
    strays: float
    slope_strays: bool
    stray_rounds: int
    single: bool


def surface_heights(xyz: Float, anchored: Bool, taken: Bool, whole: Whole | None = None) -> Heights:
    """Heights of points (n, 3), in a frame in which the slope lies flat, over triangles through the ground.

    Args:
        anchored: (n,) points near the settled cloth.
        taken: (n,) points that may be ground.
        whole: what is decided for the cloud of which these points are a part.
    """
    everything = max(int(np.count_nonzero(taken)), 1)
    whole = whole or _whole_of(xyz, taken)
    given, rounds = whole.slope_strays, whole.stray_rounds
    left = taken if given is False else _without_strays(xyz, taken, SLICE_M, whole, always=given is True)
    first = int(np.count_nonzero(left)) < int(np.count_nonzero(taken))
    if whole.outline is not None:
        even = xyz[:, 2] - whole.outline.at(xyz)
        # the cloth hangs over edges and spans valleys; over single returns it lies on roofs too
        near = np.abs(even) < NEAR_RELIEF_M
        anchored = near if whole.single else anchored | near
        xyz = np.column_stack([xyz[:, :2], even])
    height = _over_triangles(xyz, anchored, left, whole)
    done = 0
    for _ in range(STRAY_ROUNDS if rounds is None else rounds):
        # over the triangles the ground is level, so that what is not shows better
        over = np.column_stack([xyz[:, :2], height])
        level = _without_strays(over, left & np.isfinite(height), CLOSE_SLICE_M, whole, always=rounds is not None)
        if rounds is None and np.count_nonzero(level) > (1.0 - MIN_REPORTED_SHARE) * np.count_nonzero(left):
            break
        left = level
        height = _over_triangles(xyz, anchored, left, whole)
        done += 1
    return Heights(height, left, 1.0 - int(np.count_nonzero(left)) / everything, first, done, whole.single)


def _whole_of(xyz: Float, taken: Bool) -> Whole:
    """What points (n, 3) have in common that are all of a cloud."""
    corner = least(xyz[:, :2])
    return Whole(corner, seed_window_of(float(spans(xyz[:, :2]).min())), outline_of([xyz[taken]], corner))


def outline_of(parts: Iterable[Float], origin: Float | None = None) -> Relief | None:
    """The relief of a cloud whose ``parts`` are points (n, 3) that may be ground; see ``relief``."""
    low, returns = [], 0
    for points in parts:
        low.append(points[lowest_supported(points, SQUARE_M, origin)])
        returns += len(points)
    return relief(np.concatenate(low), returns, origin)


def _without_strays(xyz: Float, taken: Bool, slice_m: float, whole: Whole, *, always: bool) -> Bool:
    """(n,) those ``taken`` without stray returns below the ground, where the cloud has a noteworthy share of them."""
    index = np.flatnonzero(taken)
    stray = stray_below(xyz[index], slice_m, whole.origin)
    left = taken.copy()
    if always or np.count_nonzero(stray) >= MIN_REPORTED_SHARE * len(index):
        left[index[stray]] = False
    return left


def _over_triangles(xyz: Float, anchored: Bool, taken: Bool, whole: Whole) -> Float:
    """(n,) height over triangles through the ground's candidates, by a grid of SURFACE_CELL_M."""
    usable = np.flatnonzero(taken)
    if not len(usable):
        return np.full(len(xyz), np.inf)
    candidates = usable[lowest_supported(xyz[usable], CANDIDATE_CELL_M, whole.origin)]
    sure = whole.outline.holds(xyz[candidates]) if whole.outline is not None and whole.single else None
    vertices = candidates[densified(xyz[candidates], anchored[candidates], whole.window, sure)]
    if len(vertices) < 3:
        return np.full(len(xyz), np.inf)
    # a part of the cloud needs no nodes before its own
    low = whole.origin + SURFACE_CELL_M * np.floor((least(xyz[:, :2]) - whole.origin) / SURFACE_CELL_M)
    place = (xyz[:, :2] - low) / SURFACE_CELL_M
    node = np.floor(place).astype(np.int64)
    # a slope that lies across the axes fills little of the grid, and only nodes about its points are looked up
    needed = np.zeros(greatest(node) + 2, dtype=bool)
    for right, up in ((0, 0), (0, 1), (1, 0), (1, 1)):
        needed[node[:, 0] + right, node[:, 1] + up] = True
    surface = np.zeros(needed.shape)
    surface[needed] = Triangles(xyz[vertices]).height(low + SURFACE_CELL_M * np.argwhere(needed))
    return np.asarray(xyz[:, 2] - ndimage.map_coordinates(surface, place.T, order=1, mode="nearest"), dtype=np.float64)
