"""Windows over the map: the surfaces of both surveys, tile by tile, and one least-squares motion in each window."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float, Index
from ..core.machine_memory import machine_memory
from ..core.processors import processors
from ..core.progress import Progress
from ..geometry.columns import greatest, least
from .facets import Facets
from .frame import Frame
from .least_squares import Fit, Region, fit_motion
from .measure import MIN_INFORMATION, MIN_SEEN_SHARE
from .one_direction import Component, Gates, with_component
from .start import CELL_M, NODES, best_shifts, relief
from .status import Status
from .stored_ground import Ground, StoredGround, between, bounds_of, in_frame, parts_of
from .surface import NODE_M, gridded

_TILE_M = 24.0
_HALO_M = 1.0  # beyond the windows and the largest motion, for the kernel and the edge of the grid
_MAX_THREADS = 4
TILE_BYTES = 300_000_000
"""Memory of the surfaces of a tile while they are made, and of its windows; of a zone of 50 m, measured 330 MB."""
_MIN_START_M, _MIN_CORRELATION = 0.15, 0.3  # of a start that is tried besides no motion at all
_MIN_GAIN = 0.9  # ratio of the costs, above which the start from no motion is kept


@dataclass(frozen=True)
class Search:
    """How to look for motion.

    ``radii`` are the windows' (m), ``limit`` the largest motion along the surface (m), and ``kernel`` the standard
    deviation of the surfaces' kernel (m).
    """

    radii: tuple[float, ...]
    limit: float
    kernel: float

    @property
    def stride(self) -> int:
        """Every so many nodes are used: what lies closer together says the same."""
        return max(int(self.kernel / NODE_M), 1)

    def regions(self) -> tuple[Region, ...]:
        return tuple(Region.disc(radius, self.stride) for radius in self.radii)


@dataclass(frozen=True)
class Tile:
    """Both surfaces over a part of a facet.

    ``first`` and ``later`` are (3, rows, columns), ``nodes`` (n, 2) the middles of the windows that lie in it.
    """

    first: Float
    later: Float
    nodes: Index


@dataclass(frozen=True)
class TilePlan:
    """What a tile is made of: the surveys' points near its facet, its first node's place (2,) in the plane, rows and
    columns, numbers ``windows`` (n,) of the windows whose middles lie in it, and their ``nodes`` (n, 2).
    """

    near: tuple[_NearFacet, _NearFacet]
    corner: Float
    shape: tuple[int, int]
    windows: Index
    nodes: Index

    def made(self, search: Search) -> Tile:
        """The surfaces."""
        first, later = (
            gridded(part.within(self.corner, self.shape), self.corner, self.shape, search.kernel).values
            for part in self.near
        )
        return Tile(first, later, self.nodes)


def density(clouds: Sequence[Ground], side: float = 1.0) -> float:
    """Points a m² of the map where there are points, of the sparser cloud."""
    found = []
    for ground in clouds:
        low, high = (np.floor(end[:2] / side).astype(np.int64) for end in bounds_of(ground))
        across = int(high[1] - low[1]) + 1
        occupied = np.zeros(0, dtype=np.int64)
        for xyz in parts_of(ground):
            cells = np.floor(xyz[:, :2] / side).astype(np.int64) - low
            occupied = np.union1d(occupied, cells[:, 0] * across + cells[:, 1])
        found.append(len(ground) / (len(occupied) * side**2))
    return float(min(found))


def tiles(
    clouds: tuple[Ground, Ground],
    facets: Facets,
    places: Float,
    facet: Index,
    search: Search,
    progress: Progress,
) -> Iterator[TilePlan]:
    """What the surfaces are made of under the windows at ``places`` (n, 3), each in the frame of its ``facet`` (n,)."""
    reach = max(search.radii) + search.limit / 2 + _HALO_M
    done = 0
    for number, frame in enumerate(facets.frames):
        mine = np.flatnonzero(facet == number)
        if not len(mine):
            continue
        flat = frame.to_plane(places[mine])
        chosen = _squares_near(facets, number, reach)
        near = _near_facet(clouds[0], facets, chosen, frame), _near_facet(clouds[1], facets, chosen, frame)
        keys = np.floor(flat[:, :2] / _TILE_M).astype(np.int64)
        for key in np.unique(keys, axis=0):
            inside = (keys == key).all(axis=1)
            progress.update(done / len(places), "measuring motion along the surface")
            done += int(np.count_nonzero(inside))
            low, high = (pick(flat[inside, :2], axis=0) for pick in (np.min, np.max))
            corner = np.floor((low - reach) / CELL_M) * CELL_M
            rows, columns = (int(np.ceil(d / CELL_M)) * NODES + 1 for d in high + reach - corner)
            nodes = np.rint((flat[inside, :2] - corner) / NODE_M).astype(np.int64)
            yield TilePlan(near, corner, (rows, columns), mine[inside], nodes)
    progress.update(1.0)


class _NearFacet(Protocol):
    """Points of a facet, found by tiles."""

    def within(self, corner: Float, shape: tuple[int, int]) -> Float:
        """(n, 3) in the facet's frame, of a tile."""


class _Binned:
    """Points of a facet in memory, sorted by squares of a tile's side: row after row, each in the points' order."""

    def __init__(self, xyz: Float, frame: Frame) -> None:
        points = frame.to_plane(xyz)
        square = np.floor(points[:, :2] / _TILE_M).astype(np.int64)
        self._low: Index = least(square) if len(square) else np.zeros(2, dtype=np.int64)
        self._high: Index = greatest(square) if len(square) else self._low
        row, column = (square - self._low).T
        key = row * self._across + column
        self._number = np.argsort(key, kind="stable")
        self._points = points[self._number]
        self._named, start = np.unique(key[self._number], return_index=True)
        self._start = np.append(start, len(points))

    @property
    def _across(self) -> int:
        return int(self._high[1] - self._low[1]) + 1

    def within(self, corner: Float, shape: tuple[int, int]) -> Float:
        low, high = _ends(corner, shape)
        first, last = (
            np.clip(np.floor(end / _TILE_M).astype(np.int64), self._low, self._high) - self._low for end in (low, high)
        )
        found = [np.zeros((0, 3))]
        for row in range(int(first[0]), int(last[0]) + 1):
            keys = row * self._across + first[1], row * self._across + last[1] + 1
            start, end = (int(self._start[at]) for at in np.searchsorted(self._named, keys))
            part, number = self._points[start:end], self._number[start:end]
            inside = between(part, low, high)
            found.append(part[inside][np.argsort(number[inside], kind="stable")])
        return np.concatenate(found)


@dataclass(frozen=True)
class _OnDisk:
    """Points of a facet that are read tile by tile, in the order of ``_Binned``; ``chosen`` as of ``_near``."""

    ground: StoredGround
    facets: Facets
    chosen: Bool | None
    frame: Frame

    def within(self, corner: Float, shape: tuple[int, int]) -> Float:
        low, high = _ends(corner, shape)
        points = in_frame(self.frame, _near(self.ground.in_plane(self.frame, low, high), self.facets, self.chosen))
        return points[np.argsort(_rows(points), kind="stable")]


def _near_facet(ground: Ground, facets: Facets, chosen: Bool | None, frame: Frame) -> _NearFacet:
    if isinstance(ground, StoredGround):
        return _OnDisk(ground, facets, chosen, frame)
    return _Binned(_near(ground, facets, chosen), frame)


def _rows(points: Float) -> Index:
    return np.floor(points[:, 0] / _TILE_M).astype(np.int64)


def _ends(corner: Float, shape: tuple[int, int]) -> tuple[Float, Float]:
    """Where the points of a tile begin and end along the axes."""
    return corner - NODE_M, corner + np.array(shape) * NODE_M


def _squares_near(facets: Facets, number: int, reach: float) -> Bool | None:
    """Which squares of the map are near a facet; None: all."""
    if len(facets.frames) == 1:
        return None
    distance = ndimage.distance_transform_edt(facets.number != number) * facets.side
    return np.asarray(distance <= reach + 2 * facets.side)


def _near(xyz: Float, facets: Facets, chosen: Bool | None) -> Float:
    return xyz if chosen is None else np.asarray(xyz[chosen[facets.squares(xyz[:, :2])]])


def tile_threads(memory: float | None = None) -> int:
    """Tiles that are worked on at a time: as many as there are processors and as fit into so many bytes."""
    allowed = machine_memory() / 4 if memory is None else memory
    return max(1, min(processors(), _MAX_THREADS, int(allowed / TILE_BYTES)))


def fitted_tiles(
    plans: Iterator[TilePlan], search: Search, regions: Sequence[Region], threads: int | None = None
) -> Iterator[tuple[Index, list[list[Fit | Status | Component]]]]:
    """Of each tile the numbers of its windows, and for each radius what is found in them, in the order of the tiles.

    Args:
        threads: tiles at a time; None: as ``tile_threads``.
    """

    def fitted(plan: TilePlan) -> tuple[Index, list[list[Fit | Status | Component]]]:
        return plan.windows, fit_windows(plan.made(search), search, regions)

    threads = threads or tile_threads()
    if threads == 1:
        yield from map(fitted, plans)
        return
    waiting: deque[Future[tuple[Index, list[list[Fit | Status | Component]]]]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for plan in plans:
                waiting.append(pool.submit(fitted, plan))
                if len(waiting) > threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for rest in waiting:
                rest.cancel()


def fit_windows(tile: Tile, search: Search, regions: Sequence[Region]) -> list[list[Fit | Status | Component]]:
    """For each radius the motion in each of the tile's windows; what relief holds of it, or why there is none."""
    gates = Gates(MIN_INFORMATION, MIN_SEEN_SHARE)
    coarse = relief(tile.first), relief(tile.later)
    shifts, correlation = best_shifts(*coarse, tile.nodes // NODES, min(search.radii), search.limit)
    far = (np.hypot(*shifts.T) > _MIN_START_M) & (correlation > _MIN_CORRELATION)
    found = []
    for region in regions:
        fits: list[Fit | Status | Component] = []
        for node, shift, other in zip(tile.nodes, shifts, far, strict=True):
            middle, start = (int(node[0]), int(node[1])), shift if other else None
            fit = best_fit(tile, region, middle, start, search.limit)
            fits.append(with_component(fit, gates, (tile.first, tile.later), region, middle, (search.limit, start)))
        found.append(fits)
    return found


def best_fit(tile: Tile, region: Region, middle: tuple[int, int], start: Float | None, limit: float) -> Fit | Status:
    """The motion from no motion, or from ``start`` where that leads to a clearly better agreement."""
    still = fit_motion(tile.first, tile.later, region, middle, np.zeros(2), limit)
    if start is None:
        return still
    moved = fit_motion(tile.first, tile.later, region, middle, start, limit)
    if isinstance(moved, Status):
        return still
    if isinstance(still, Status):
        return moved
    if not still.converged:
        return moved
    return moved if moved.converged and moved.scale < _MIN_GAIN * still.scale else still
