"""The cloth and the triangles in tiles: heights of all points over the ground's candidates, and how tiles agree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ....interface.parameters import GroundParameters
from ...core.arrays import Bool, Float, Index
from ...geometry.dominant_plane import Plane, apply_matrix, unflattening_matrix
from ..cloth import cloth_ground
from ..filtering import cloth_threshold
from ..layered_ground import of_lowest_layers
from ..lowest_layer import HIGHEST_M, LOWEST_M
from ..surface_heights import Whole, outline_of, surface_heights
from .layout import HALO_M
from .spool import SURFACE, Around, Spool

PILOTS = 3
"""Tiles that decide for all whether strays are taken out."""
SEAM_M = 1.0
"""Width of the strip beyond a tile's edge in which its heights are compared with those of the next tile."""
MAX_SEAM_DIFFERENCE_M = 0.02
"""Difference of heights from which points at a seam are counted."""


@dataclass(frozen=True)
class Seams:
    """How the heights of adjoining tiles agree in strips along their seams.

    ``points`` in those strips; ``share_beyond`` of them differ by more than MAX_SEAM_DIFFERENCE_M; ``median_m`` and
    ``p99_m`` are quantiles of the difference, metres, 0 without seams.
    """

    points: int
    share_beyond: float
    median_m: float
    p99_m: float


@dataclass(frozen=True)
class Surfaces:
    """What the first round over the tiles found; each tile's heights are saved as ``SURFACE`` records.

    ``strays`` is the share of stray returns that were left out; ``low_corner`` (2,) m the least coordinates of those
    that take part in the windows, infinite without any.
    """

    whole: Whole
    strays: float
    low_corner: Float
    seams: Seams


@dataclass(frozen=True)
class Cloth:
    """How a cloth is laid over a part of a cloud: by which plane and parameters; ``low`` see ``Kept.cloth_low``."""

    plane: Plane
    parameters: GroundParameters
    low: Float


def near_cloth(around: Around, cloth: Cloth) -> Bool:
    """(n,) points of a tile and its halo near a cloth of their own."""
    parameters = cloth.parameters
    near = np.zeros(len(around.flat), dtype=bool)
    points = around.flat[around.taken]
    if not parameters.slope_aligned:
        points = apply_matrix(unflattening_matrix(cloth.plane), points)
    threshold = cloth_threshold(parameters)
    near[around.taken] = cloth_ground(points, parameters, threshold=threshold, origin=cloth.low)
    return near


@dataclass(frozen=True)
class _Laid:
    """What a tile's surface adds to those of all."""

    slope_strays: bool
    stray_rounds: int
    low_corner: Float
    taken: int
    left: int
    strip: tuple[Index, Index, Float]


def lay_surfaces(spool: Spool, cloth: Cloth, whole: Whole, done: Callable[[int], None]) -> Surfaces:
    """Heights over the triangles in every tile.

    Args:
        whole: of which the outline is not known and strays are not decided yet.
        done: called after each tile with their number so far.
    """
    whole = replace(whole, outline=outline_of(_cores(spool), whole.origin))
    tried = {tile: _lay(spool, tile, cloth, whole) for tile in _pilots(spool)}
    # most of some tiles decide for all, by their own shares of strays
    first = np.median([laid.slope_strays for laid in tried.values()]) > 0.5
    rounds = int(np.median([laid.stray_rounds for laid in tried.values()]))
    whole = replace(whole, slope_strays=bool(first), stray_rounds=rounds)
    corner, taken, left = np.full(2, np.inf), 0, 0
    strips = []
    for tile in range(len(spool.tiles)):
        laid = tried.get(tile)
        if laid is None or (laid.slope_strays, laid.stray_rounds) != (first, rounds):
            laid = _lay(spool, tile, cloth, whole)
        corner = np.minimum(corner, laid.low_corner)
        taken, left = taken + laid.taken, left + laid.left
        strips.append(laid.strip)
        done(tile + 1)
    return Surfaces(whole, 1.0 - left / max(taken, 1), corner, _seams(spool, strips))


def _pilots(spool: Spool) -> list[int]:
    """Some tiles, evenly over the slope, that hold at least as many points as half of all."""
    full = np.flatnonzero(spool.counts >= np.median(spool.counts))
    return [int(full[i]) for i in np.unique(np.linspace(0, len(full) - 1, PILOTS).round().astype(np.int64))]


def _cores(spool: Spool) -> Iterator[Float]:
    """The points (n, 3) of each tile that may be ground."""
    for tile in range(len(spool.tiles)):
        (around,) = spool.read(tile, 0.0)
        yield around.flat[: around.core][around.taken[: around.core]]


def _lay(spool: Spool, tile: int, cloth: Cloth, whole: Whole) -> _Laid:
    """Heights in one tile, which are saved."""
    (around,) = spool.read(tile, HALO_M)
    found = surface_heights(around.flat, near_cloth(around, cloth), around.taken, whole)
    core = slice(0, around.core)
    records = np.empty(around.core, SURFACE)
    records["height"], records["left"] = found.height[core], found.left[core]
    spool.save(tile, records, "surface")
    low = of_lowest_layers(found.height[core], found.left[core])
    return _Laid(
        found.slope_strays,
        found.stray_rounds,
        around.flat[core][low, :2].min(axis=0, initial=np.inf),
        int(np.count_nonzero(around.taken[core])),
        int(np.count_nonzero(found.left[core])),
        _strip(spool, tile, around, found.height),
    )


def _strip(spool: Spool, tile: int, around: Around, height: Float) -> tuple[Index, Index, Float]:
    """Tile, place there and height here of the points of the next tiles that lie right beyond the edge."""
    halo = slice(around.core, None)
    chosen = spool.tiles.within(tile, around.flat[halo], SEAM_M)
    chosen &= (height[halo] > LOWEST_M) & (height[halo] < HIGHEST_M)
    return around.own[chosen].astype(np.int64), around.place[chosen], height[halo][chosen]


def _seams(spool: Spool, strips: list[tuple[Index, Index, Float]]) -> Seams:
    """Differences between the heights (n,) in strips and those of the tiles they lie in."""
    own, place, height = (np.concatenate(parts) for parts in zip(*strips, strict=True))
    difference = np.zeros(len(own))
    for tile in np.unique(own).tolist():
        chosen = own == tile
        # far from all candidates a height is infinite, which has no quantiles
        theirs = np.clip(spool.load(tile, "surface", SURFACE)["height"][place[chosen]], LOWEST_M, HIGHEST_M)
        difference[chosen] = np.abs(height[chosen] - theirs)
    if not len(difference):
        return Seams(0, 0.0, 0.0, 0.0)
    median, most = (float(np.quantile(difference, q)) for q in (0.5, 0.99))
    return Seams(len(difference), float(np.mean(difference > MAX_SEAM_DIFFERENCE_M)), median, most)
