"""Windows over the map: the surfaces of both surveys, tile by tile, and one least-squares motion in each window."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float, Index
from ..core.progress import Progress
from .facets import Facets, Frame
from .least_squares import Fit, Region, fit_motion
from .measure import MIN_INFORMATION, MIN_SEEN_SHARE
from .one_direction import Component, Gates, with_component
from .start import CELL_M, NODES, best_shifts, relief
from .status import Status
from .surface import NODE_M, gridded

_TILE_M = 24.0
_HALO_M = 1.0  # beyond the windows and the largest motion, for the kernel and the edge of the grid
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
    """Both surfaces over a part of a facet, and the windows whose middles lie in it.

    ``first`` and ``later`` are (3, rows, columns), ``windows`` (n,) their numbers, ``nodes`` (n, 2) their middles.
    """

    first: Float
    later: Float
    corner: Float
    windows: Index
    nodes: Index


def density(clouds: Sequence[Float], side: float = 1.0) -> float:
    """Points a m² of the map where there are points, of the sparser cloud."""
    found = []
    for xyz in clouds:
        cells = np.floor(xyz[:, :2] / side).astype(np.int64)
        cells -= cells.min(axis=0)
        key = cells[:, 0] * (int(cells[:, 1].max()) + 1) + cells[:, 1]
        found.append(len(xyz) / (len(np.unique(key)) * side**2))
    return float(min(found))


def tiles(
    clouds: tuple[Float, Float],
    facets: Facets,
    places: Float,
    facet: Index,
    search: Search,
    progress: Progress,
) -> Iterator[Tile]:
    """The surfaces under the windows at ``places`` (n, 3), each in the frame of its ``facet`` (n,)."""
    reach = max(search.radii) + search.limit / 2 + _HALO_M
    done = 0
    for number, frame in enumerate(facets.frames):
        mine = np.flatnonzero(facet == number)
        if not len(mine):
            continue
        flat = frame.to_plane(places[mine])
        near = tuple(_Binned(_near(xyz, facets, number, reach), frame) for xyz in clouds)
        keys = np.floor(flat[:, :2] / _TILE_M).astype(np.int64)
        for key in np.unique(keys, axis=0):
            inside = (keys == key).all(axis=1)
            progress.update(done / len(places), "measuring motion along the surface")
            done += int(np.count_nonzero(inside))
            low, high = (pick(flat[inside, :2], axis=0) for pick in (np.min, np.max))
            corner = np.floor((low - reach) / CELL_M) * CELL_M
            rows, columns = (int(np.ceil(d / CELL_M)) * NODES + 1 for d in high + reach - corner)
            shape = (rows, columns)
            nodes = np.rint((flat[inside, :2] - corner) / NODE_M).astype(np.int64)
            first, later = (gridded(part.within(corner, shape), corner, shape, search.kernel).values for part in near)
            yield Tile(first, later, corner, mine[inside], nodes)
    progress.update(1.0)


class _Binned:
    """Points of a facet, found by tiles."""

    def __init__(self, xyz: Float, frame: Frame) -> None:
        points = frame.to_plane(xyz)
        row = np.floor(points[:, 0] / _TILE_M).astype(np.int64)
        order = np.argsort(row, kind="stable")
        self.points, self.row = points[order], row[order]

    def within(self, corner: Float, shape: tuple[int, int]) -> Float:
        low, high = corner - NODE_M, corner + np.array(shape) * NODE_M
        rows = np.floor(np.array([low[0], high[0]]) / _TILE_M)
        start, end = np.searchsorted(self.row, rows[0]), np.searchsorted(self.row, rows[1], side="right")
        part = self.points[start:end]
        return part[((part[:, :2] >= low) & (part[:, :2] <= high)).all(axis=1)]


def _near(xyz: Float, facets: Facets, number: int, reach: float) -> Float:
    if len(facets.frames) == 1:
        return xyz
    distance = ndimage.distance_transform_edt(facets.number != number) * facets.side
    near: Bool = distance <= reach + 2 * facets.side
    return np.asarray(xyz[near[facets.squares(xyz[:, :2])]])


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
