"""Second step of the ground extraction: which points near the settled cloth lie on the ground itself.

A cloth is smooth. It cuts off the tops of steps and cones that are smaller than its bends, and its distance to the
ground varies by more than the noise of a survey, so that one threshold either loses ground or lets grass in. Here
the cloth only says where the ground may be. The surface is then taken from the points themselves:

1. The lowest points of small cells, opened morphologically (Zhang et al. 2003, doi:10.1109/TGRS.2003.810682): what is
   narrower than the window and stands on ground goes, a plateau as wide as the window stays with sharp edges.
2. Local planes, fitted to the points near that surface by iteratively reweighted least squares whose weights fall
   quickly above the surface (plants) and slowly below it (noise), as Kraus and Pfeifer 1998
   (doi:10.1016/S0924-2716(98)00009-4) do; first on wide cells, then on narrow ones, there with a prior that keeps the
   wide surface where few points are.
3. Points within a threshold of the surface are ground. It widens with the scatter that the points below the surface
   show, because rough or sparse ground scatters more.
4. The ground found is continued along its own planes, and what lies close to them is looked at again, until no more
   comes: a cloth hangs free where it should bend around the edge of a berm.

All lengths follow the spacing of the points. Sources of the constants: measured, see benchmarks/ground.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .plane_cells import Planes

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

CELLS_PER_SPACING = 1.2
SMALLEST_CELL = 0.1
WINDOW = 3
"""Cells on a side of the opening's window."""
SPREAD = 2.5
"""The threshold is at least so many times the scatter."""
ROUNDS = 10
"""Times that the ground is continued at most."""
MUCH_MORE = 0.2
"""Share of the ground that, once that many candidates have come, has spacing and scatter judged again."""
GROWTH_SIDE, GROWTH_REACH, GROWTH_SHARE = 0.5, 0.3, 0.35
"""Least side (m) of the cells that continue the ground, and reach of their planes: at least m, share of the side."""
TILE, MARGIN = 200.0, 10.0
LEVELS = ((2.0, 4, 0.0, 0.05), (1.0, 3, 1.0, 0.05))
"""Side of the planes' cells (in cells), rounds, weight of the priors: on height (in points), on inclination (share)."""


@dataclass(frozen=True)
class GroundSurface:
    """``ground`` (n,) bool and the lengths (m) that led to it.

    ``cell`` is that of the opening, ``gate`` the height above it that was looked at, ``scatter`` that of the ground,
    ``threshold`` the one applied.
    """

    ground: BoolArray
    cell: float
    gate: float
    scatter: float
    threshold: float


def ground_surface(xyz: FloatArray, near: BoolArray, threshold: float) -> GroundSurface:
    """Ground among points of which the cloth found some near.

    Args:
        xyz: (n, 3) in metres, in a frame in which the terrain is roughly level.
        near: (n,) which points lie within some decimetres of the cloth.
        threshold: least distance (m) to the surface within which a point is ground.
    """
    taken = near
    # what the cloth found may be too little to judge spacing and scatter by; with much more of it, judge again
    for _ in range(3):
        index = np.flatnonzero(taken)
        surface = ground_near_surface(xyz[index], threshold)
        ground = np.zeros(len(xyz), dtype=bool)
        ground[index[surface.ground]] = True
        if not ground.any():
            break
        taken, ground = _continued(xyz, taken, ground, surface)
        if np.count_nonzero(taken) - len(index) <= MUCH_MORE * np.count_nonzero(ground):
            break
    return replace(surface, ground=ground)


def _continued(
    xyz: FloatArray, taken: BoolArray, ground: BoolArray, surface: GroundSurface
) -> tuple[BoolArray, BoolArray]:
    """Step 4: candidates and ground after the ground was continued until no more came."""
    # only what lies around new candidates can change, so the work shrinks from round to round
    blocks = _Blocks(xyz, 8.0 * surface.cell)
    side = max(GROWTH_SIDE, 4.0 * surface.cell)
    taken, ground, changed = taken.copy(), ground.copy(), blocks.everywhere()
    for _ in range(ROUNDS):
        index = np.flatnonzero(blocks.points(changed, 2))
        beside = _in_tiles(np.column_stack([xyz[index], ground[index]]), partial(_beside, side=side))
        new = np.zeros(len(xyz), dtype=bool)
        new[index[beside]] = True
        new &= blocks.points(changed, 1) & ~taken
        if not new.any():
            break
        taken |= new
        changed = blocks.of(new)
        index = np.flatnonzero(blocks.points(changed, 2) & taken)
        residual = _in_tiles(xyz[index], partial(_residuals, cell=surface.cell, gate=surface.gate))[:, 1]
        inner = blocks.points(changed, 1)[index]
        ground[index[inner]] = np.abs(residual[inner]) <= surface.threshold
    return taken, ground


def ground_near_surface(xyz: FloatArray, threshold: float) -> GroundSurface:
    """Ground among candidates (n, 3) alone, see ``ground_surface``: steps 1 to 3."""
    if len(xyz) < 3:
        return GroundSurface(np.zeros(len(xyz), dtype=bool), SMALLEST_CELL, 0.0, 0.0, threshold)
    cell = max(SMALLEST_CELL, CELLS_PER_SPACING * point_spacing(xyz[:, :2]))
    scatter = 0.0
    # the lowest of scattering points lie the deeper the more they scatter; the gate above them must let the rest in
    for _ in range(3):
        gate = cell + max(0.05, 4.0 * scatter)
        wide, residual = _in_tiles(xyz, partial(_residuals, cell=cell, gate=gate)).T
        # plants only add points above the surface, so the side below shows the ground's own scatter
        beneath = wide[(wide < 0) & (wide > -gate)]
        scatter = 1.4826 * float(np.median(-beneath)) if len(beneath) else 0.0
        if cell + 4.0 * scatter <= 1.2 * gate:
            break
    threshold = max(threshold, SPREAD * scatter)
    return GroundSurface(np.abs(residual) <= threshold, cell, gate, scatter, threshold)


def _residuals(xyz: FloatArray, cell: float, gate: float) -> FloatArray:
    """(n, 2) height above the surface of wide and of narrow planes; infinite farther than ``gate`` above the opened."""
    local = xyz - _corner(xyz, 2.0 * cell)
    near = np.flatnonzero(local[:, 2] < _opened(local, cell) + gate)
    local = local[near]
    everywhere = np.full((len(xyz), 2), np.inf)
    residual = local[:, 2]
    for level, (side, rounds, prior_height, prior_slope) in enumerate(LEVELS):
        planes = Planes(local[:, :2] / (side * cell))
        start, weight = residual, np.ones(len(local))
        for _ in range(rounds):
            residual = start - planes.at_points(*planes.fit(start, weight, prior_height, prior_slope))
            above, below = 0.3 * gate, 0.4 * gate
            weight = np.where(residual < 0, 1.0 / (1.0 + (residual / below) ** 2), np.exp(-((residual / above) ** 2)))
        everywhere[near, level] = residual
    return everywhere


def _corner(xyz: FloatArray, step: float) -> FloatArray:
    """A corner below all points that is a multiple of ``step``, so that a part of the points has the cells of all."""
    return np.append(np.floor(xyz[:, :2].min(axis=0) / step) * step, xyz[:, 2].min())


class _Blocks:
    """A coarse grid over the points, to name the parts of them."""

    def __init__(self, xyz: FloatArray, side: float) -> None:
        low, extent = xyz[:, :2].min(axis=0), np.ptp(xyz[:, :2], axis=0)
        side = max(1.0, side, math.sqrt(float(extent.prod()) / 1e7))
        index = np.floor((xyz[:, :2] - low) / side).astype(np.int64)
        self._shape = tuple(int(n) + 1 for n in index.max(axis=0))
        self._key = index[:, 0] * self._shape[1] + index[:, 1]

    def everywhere(self) -> BoolArray:
        return np.ones(self._shape, dtype=bool)

    def of(self, points: BoolArray) -> BoolArray:
        """The blocks that hold some of the points (n,)."""
        found = np.zeros(self._shape, dtype=bool)
        found.ravel()[self._key[points]] = True
        return found

    def points(self, blocks: BoolArray, margin: int) -> BoolArray:
        """(n,) which points lie in blocks or within so many blocks of them."""
        wider = ndimage.binary_dilation(blocks, np.ones((3, 3), dtype=bool), iterations=margin)
        return np.asarray(wider.ravel()[self._key], dtype=np.bool_)


def _in_tiles(xyz: FloatArray, work: Callable[[FloatArray], NDArray[Any]]) -> NDArray[Any]:
    """``work`` on square tiles with a margin, because its grids need memory by area; a result for each point."""
    low = xyz.min(axis=0)[:2]
    if np.ptp(xyz[:, :2], axis=0).max() <= 1.5 * TILE:
        return work(xyz)
    index = np.floor((xyz[:, :2] - low) / TILE).astype(np.int64)
    result: NDArray[Any] | None = None
    for tile in np.unique(index, axis=0):
        corner = low + tile * TILE
        inside = (xyz[:, :2] >= corner - MARGIN).all(axis=1) & (xyz[:, :2] < corner + TILE + MARGIN).all(axis=1)
        part = np.flatnonzero(inside)
        core = (index[part] == tile).all(axis=1)
        values = work(xyz[part])
        if result is None:
            result = np.empty((len(xyz), *values.shape[1:]), dtype=values.dtype)
        result[part[core]] = values[core]
    assert result is not None
    return result


def point_spacing(xy: FloatArray) -> float:
    """Mean spacing (m) of points (n, 2) seen from above: the root of the median area a point has in occupied cells."""
    low = xy.min(axis=0)
    extent = float(np.ptp(xy, axis=0).max())
    cell = 1.0
    while True:
        keys = np.floor((xy - low) / cell).astype(np.int64)
        _, counts = np.unique(keys[:, 0] * (int(keys[:, 1].max()) + 1) + keys[:, 1], return_counts=True)
        density = float(np.median(counts))
        # cells of a point or two say nothing of the gaps between them
        if density >= 8 or cell >= extent:
            return cell / math.sqrt(density)
        cell *= 2.0


def _beside(marked: FloatArray, side: float) -> BoolArray:
    """(n,) points close to planes of the ground in cells of ``side`` metres, or to these planes continued by a cell.

    ``marked`` (n, 4) are coordinates and 1 for ground, else 0.
    """
    ground = marked[:, 3] > 0
    local = marked[:, :3] - _corner(marked[:, :3], side)
    planes = Planes(local[:, :2] / side)
    height, along, across = planes.fit(local[:, 2], ground.astype(np.float64), 0.0, 0.02)
    known = planes.sum(ground.astype(np.float64)) >= 3
    if not known.any():
        return np.zeros(len(marked), dtype=bool)
    distance, (i, j) = ndimage.distance_transform_edt(~known, return_indices=True)
    rows, columns = np.indices(known.shape)
    height = height[i, j] + along[i, j] * (rows - i) + across[i, j] * (columns - j)
    reach = max(GROWTH_REACH, GROWTH_SHARE * side)
    near = np.abs(local[:, 2] - planes.at_points(height, along[i, j], across[i, j])) < reach
    return near & (distance <= 1.5).ravel()[planes.key]


def _opened(local: FloatArray, cell: float) -> FloatArray:
    """(n,) height, at each point, of the morphological opening of the lowest points' grid."""
    index = np.floor(local[:, :2] / cell).astype(np.int64)
    shape = tuple(index.max(axis=0) + 1)
    key = index[:, 0] * shape[1] + index[:, 1]
    lowest = np.full(shape[0] * shape[1], np.inf)
    np.minimum.at(lowest, key, local[:, 2])
    eroded = ndimage.minimum_filter(lowest.reshape(shape), size=WINDOW, mode="nearest")
    eroded[np.isinf(eroded)] = -np.inf
    opened = ndimage.maximum_filter(eroded, size=WINDOW, mode="nearest")
    return np.asarray(opened.ravel()[key], dtype=np.float64)
