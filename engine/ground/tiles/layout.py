"""Where tiles lie in the slope's frame, and how large they may be within a memory limit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ....interface.parameters import GroundParameters
from ...core.arrays import Bool, Float, Index
from ..cloth import MAX_CLOTH_PARTICLES

COARSE_M = 5
"""Squares in which points are counted to choose a side; sides and halos are multiples of it, metres."""
HALO_M, JUDGED_HALO_M = 25, 20
"""Widths around a tile from which points come along: for the cloth and the triangles, and for the windows, which reach
18 m (a margin of 9 m, and the ground of windows up to 6 m away)."""
MIN_SIDE_M = 25
"""Smaller tiles would mostly be halo."""
SURFACE_BYTES, PARTICLE_BYTES, JUDGED_BYTES = 270, 400, 135
"""Memory of a point of a tile with its halo while its surface is laid, of a particle of its cloth, and of a point while
the ground is judged; measured, see docs/large_ground.md."""
WINDOWS_BYTES, WINDOWS_WIDTH_M = 610, 90
"""While the ground is judged, more for each point of a square so wide: ``layered_ground`` takes as much at once."""


@dataclass(frozen=True)
class Tiles:
    """Square tiles of ``side`` m in columns and rows from ``low`` (2,) on; ``held`` are those with points, ascending.

    A tile is known by its place among ``held``. ``points`` is the largest number of a tile with its halo.
    """

    low: Float
    side: float
    rows: int
    held: Index
    points: int

    def __len__(self) -> int:
        return len(self.held)

    def of(self, flat: Float) -> NDArray[np.int32]:
        """(n,) the tile of each of the points (n, 2+)."""
        place = np.floor((flat[:, :2] - self.low) / self.side).astype(np.int64)
        found = np.searchsorted(self.held, place[:, 0] * self.rows + place[:, 1])
        return np.minimum(found, len(self.held) - 1).astype(np.int32)

    def corner(self, tile: int) -> Float:
        """(2,) south-west corner of a tile, m."""
        return self.low + self.side * np.array(divmod(int(self.held[tile]), self.rows), dtype=np.float64)

    def around(self, tile: int, halo: float) -> list[int]:
        """The other tiles that reach into the halo of a tile."""
        reach = math.ceil(halo / self.side)
        column, row = divmod(int(self.held[tile]), self.rows)
        numbers = [
            (column + i) * self.rows + row + j
            for i in range(-reach, reach + 1)
            for j in range(-reach, reach + 1)
            if (i or j) and column + i >= 0 and 0 <= row + j < self.rows
        ]
        place = np.searchsorted(self.held, numbers)
        return [int(p) for p, n in zip(place, numbers, strict=True) if p < len(self.held) and self.held[p] == n]

    def within(self, tile: int, flat: Float, halo: float) -> Bool:
        """(n,) which of the points (n, 2+) lie in a tile or its halo."""
        corner = self.corner(tile)
        inside = (flat[:, :2] >= corner - halo) & (flat[:, :2] < corner + self.side + halo)
        return np.asarray(inside.all(axis=1), dtype=np.bool_)


@dataclass(frozen=True)
class Counted:
    """``counts`` (columns, rows) points in squares of COARSE_M from ``low`` (2,) on, m.

    ``at_once`` is the most in any square of WINDOWS_WIDTH_M.
    """

    low: Float
    counts: Float
    at_once: int = 0

    def fullest(self, width: int) -> int:
        """Most points in any square of so many metres, a multiple of COARSE_M."""
        reach = width // COARSE_M
        total = np.pad(self.counts, (reach, reach)).cumsum(axis=0).cumsum(axis=1)
        total = total[reach:] - total[:-reach]
        return int((total[:, reach:] - total[:, :-reach]).max())


def counted(places: Index, counts: Float) -> Counted:
    """Squares of COARSE_M from squares of a metre: their columns and rows (m, 2) and points (m,)."""
    coarse = places // COARSE_M
    first = coarse.min(axis=0)
    shape = coarse.max(axis=0) - first + 1
    key = (coarse[:, 0] - first[0]) * int(shape[1]) + coarse[:, 1] - first[1]
    found = Counted(first * float(COARSE_M), np.bincount(key, counts, int(shape.prod())).reshape(shape))
    return replace(found, at_once=found.fullest(WINDOWS_WIDTH_M))


def largest_tiles(found: Counted, free: float, parameters: GroundParameters) -> Tiles | None:
    """The largest tiles of which each fits with its halo; None where not even the smallest do.

    Args:
        free: bytes for a tile.
    """
    for side in sides(found):
        tiles = tiles_of(found, side)
        if tile_bytes(found, side, tiles.points, parameters) <= free:
            return tiles
    return None


def sides(found: Counted) -> Iterator[int]:
    """Sides (m) that are tried, from one tile for all down to the smallest."""
    extent, last = COARSE_M * max(found.counts.shape), 0
    for parts in range(1, extent // MIN_SIDE_M + 2):
        side = max(COARSE_M * math.ceil(extent / parts / COARSE_M), MIN_SIDE_M)
        if side != last:
            yield side
        last = side


def tile_bytes(found: Counted, side: int, points: int, parameters: GroundParameters) -> float:
    """Memory that a tile of ``side`` m takes with so many points; infinite where its cloth would be too large."""
    width, depth = (min(side + 2 * HALO_M, COARSE_M * n) for n in found.counts.shape)
    particles = (width / parameters.cloth_resolution + 4) * (depth / parameters.cloth_resolution + 4)
    if particles > MAX_CLOTH_PARTICLES:
        return math.inf
    judged = JUDGED_BYTES * points + WINDOWS_BYTES * min(points, found.at_once)
    return max(SURFACE_BYTES * points + PARTICLE_BYTES * particles, judged)


def tiles_of(found: Counted, side: int) -> Tiles:
    """The tiles of ``side`` m, a multiple of COARSE_M, that hold points."""
    step, halo = side // COARSE_M, HALO_M // COARSE_M
    columns, rows = (-(-n // step) for n in found.counts.shape)
    total = np.zeros((columns * step + 1, rows * step + 1))
    inner = np.zeros((columns * step, rows * step))
    inner[: found.counts.shape[0], : found.counts.shape[1]] = found.counts
    total[1:, 1:] = inner.cumsum(axis=0).cumsum(axis=1)

    def sums(around: int) -> Float:
        first, last = (
            [np.clip(np.arange(n) * step + shift, 0, n * step) for n in (columns, rows)]
            for shift in (-around, step + around)
        )
        corners = [total[np.ix_(a, b)] for a in (first[0], last[0]) for b in (first[1], last[1])]
        return np.asarray(corners[3] - corners[2] - corners[1] + corners[0])

    held = np.flatnonzero(sums(0) > 0)
    return Tiles(found.low, float(side), rows, held, int(sums(halo).ravel()[held].max()))
