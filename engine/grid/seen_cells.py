"""Which cells of a grid have ground of a survey nearby, and which may be compared at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ...interface.seen import REACH_M
from ..core.arrays import Bool, Float
from .block_moments import UU, VV, Moments, U, V
from .cell_statistics import cell_index
from .grid import Grid


@dataclass(frozen=True)
class Cells:
    """A choice of cells of a grid, held as one bit a cell."""

    shape: tuple[int, int]
    bits: NDArray[np.uint8]

    @classmethod
    def of(cls, cells: Bool) -> Cells:
        """Those of ``cells`` (rows, columns) that are set."""
        return cls((cells.shape[0], cells.shape[1]), np.packbits(cells))

    @property
    def array(self) -> Bool:
        """(rows, columns)."""
        return np.unpackbits(self.bits, count=math.prod(self.shape)).reshape(self.shape).astype(bool)


@dataclass(frozen=True)
class SeenCells:
    """What decides which cells of a slope two surveys can compare.

    Attributes:
        near: cells with ground of the first and of the later survey nearby; None if the points of the cells tell it.
        inside: cells of the slope; None if only the surveys bound it.
        excluded: cells that somebody excluded from the comparison.
    """

    near: tuple[Cells, Cells] | None = None
    inside: Cells | None = None
    excluded: Cells | None = None

    @property
    def allowed(self) -> Bool | None:
        """Cells (rows, columns) that may be compared; None for all."""
        if self.excluded is None:
            return None if self.inside is None else self.inside.array
        return ~self.excluded.array if self.inside is None else self.inside.array & ~self.excluded.array


def near_ground(moments: Moments) -> Bool:
    """As ``near_points``, from sums of the points: a point lies within a distance if the root mean square of a cell's
    points does. That misses a point of a cell whose points are far apart: up to a tenth of the cells of 1 m.
    """
    return _near(moments.count > 0, moments.side, lambda edge: _places(moments, np.nonzero(edge)))


def near_points(xyz: Float, grid: Grid) -> Bool:
    """Cells (rows, columns) with a point (n, 3) within themselves or within ``REACH_M`` of their centre."""
    index = cell_index(xyz, grid)
    inside = index >= 0
    xyz, index = xyz[inside], index[inside]
    hit = np.zeros(grid.shape, dtype=bool)
    hit.ravel()[index] = True
    first = grid.west + grid.cell / 2, grid.north - grid.cell / 2
    return _near(hit, grid.cell, lambda edge: xyz[edge.ravel()[index], :2] - first)


def _near(hit: Bool, side: float, places: Callable[[Bool], Float]) -> Bool:
    """Cells of ``side`` m with a point, or near one: ``places`` (n, 2 or 3) of the points in some cells, m from the
    middle of the first cell. A third one adds to the distance.
    """
    if not hit.any():
        return hit
    away = ndimage.distance_transform_edt(~hit) * side
    half = side * math.sqrt(0.5)
    near = hit | (away + half <= REACH_M)
    doubtful = np.nonzero(~near & (away - half <= REACH_M))
    if doubtful[0].size:
        # the points of a third cell from the edge of those hit are farther away than all of the first one
        known = places(hit & ~ndimage.binary_erosion(hit, np.ones((5, 5))))
        centres = np.zeros((doubtful[0].size, known.shape[1]))
        centres[:, :2] = _middles(doubtful, side)
        nearest, _ = cKDTree(known).query(centres, distance_upper_bound=REACH_M * (1.0 + 1e-9))
        near[doubtful] = np.isfinite(nearest)
    return near


def near_cells(hit: Bool, cell: float) -> Bool:
    """As ``near_ground``, from the cells (rows, columns) with points alone, whose middles stand for these."""
    if not hit.any():
        return hit
    return np.asarray(hit | (ndimage.distance_transform_edt(~hit) * cell <= REACH_M))


def _places(moments: Moments, cells: tuple[NDArray[np.intp], ...]) -> Float:
    """(n, 3) mean east and north of the points of each of the ``cells``, and their distance to it (rms), m.

    The distance in these three is the root mean square of that of the points to a place with a third one of zero.
    """
    count = moments.count[cells]
    mean = np.column_stack([moments.sums[U][cells], moments.sums[V][cells]]) / count[:, None]
    squares = (moments.sums[UU][cells] + moments.sums[VV][cells]) / count - (mean**2).sum(axis=1)
    return np.column_stack([_middles(cells, moments.side) + mean, np.sqrt(np.maximum(squares, 0.0))])


def _middles(cells: tuple[NDArray[np.intp], ...], side: float) -> Float:
    """(n, 2) east and north of the middles of ``cells`` from that of the first, m."""
    return np.column_stack([cells[1], -cells[0]]) * side
