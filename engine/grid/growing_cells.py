"""Change in cells that grow where points are few, until their level of detection or a largest size is reached."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...interface.parameters import ChangeParameters
from ..core.arrays import Float
from ..core.progress import Progress
from ..pointcloud.plant_cover import PlantCover
from .block_moments import cell_moments
from .chosen_cell import largest_step, level_step
from .grid import Grid, cell_index
from .grown_cells import COLUMNS, PRIOR_RADIUS_BLOCKS, Grown, Growth, grow
from .partition import Partition
from .plant_cells import PlantCells, together

_AT_ONCE = 1_000_000  # cells of a grid that is worked on as a whole
_TILE = 384  # cells along the side of a part of a larger one


@dataclass(frozen=True)
class AdaptiveCells:
    """Change in blocks of cells; arrays of the grid's shape, in which all cells of a block have its values.

    Attributes:
        dz: change, m; NaN where no block is.
        sampling: standard error of ``dz`` by the points alone, m.
        height_from, height_to: heights of the epochs' planes at the cell's centre, m.
        slope: inclination of the block's planes, degrees.
        count_from, count_to: points of the block in either epoch; outside of blocks, of the cell.
        points: points of each cell itself in either epoch.
        partition: the blocks.
        plants: the heights' errors by plants, and the plants' heights; None where nothing is known of them.
    """

    dz: Float
    sampling: Float
    height_from: Float
    height_to: Float
    slope: Float
    count_from: NDArray[np.int32]
    count_to: NDArray[np.int32]
    points: tuple[NDArray[np.int32], NDArray[np.int32]]
    partition: Partition
    plants: PlantCells | None = None


def adaptive_cells(
    reference: Float,
    moving: Float,
    grid: Grid,
    parameters: ChangeParameters,
    *,
    registration_error: float = 0.0,
    inside: NDArray[np.bool_] | None = None,
    plants: tuple[PlantCover | None, PlantCover | None] = (None, None),
    progress: Progress | None = None,
) -> AdaptiveCells:
    """Change of each block: the smallest of cell, 2 x 2, 4 x 4 ... cells that meets ``target_level``.

    From the finest size up, a block is taken where both epochs have enough points in it, its gradient is
    determined, and its level of detection is at most ``target_level``, or more the registration's and the plants'
    than the points', so that a larger one would gain little; from the largest size on, whatever the level is. Where
    that is left to the clouds, cells double once more and again for as long as many places have too few points of an
    epoch (``chosen_cell.largest_step``): growth ends where the ground runs out. Where a
    change is clear, one point less suffices and its level may be a quarter of it: a larger block would blur the tip
    of a cone and the edge of a step, and on unchanged ground so clear a change does not come by chance (eight
    standard errors). What is taken leaves with its points: a larger block is what is left of its square, so that
    the errors of two blocks are independent but for the registration. Single cells here and there in a square, less
    than a quarter of it, are no block: their mean would be that of places far apart. They, and what has too few
    points of its own, get the change of the smallest whole square that serves, whose points finer blocks in it have
    used as well. A quarter of a block without any point does not count as compared, nor does what lies outside of
    either survey, gaps within it aside. Blocks lie at multiples of their side whatever the extent of the clouds.

    The surface of a block is a pair of parallel planes (see ``block_moments.parallel_planes``). The variance of a point
    about them is moderated by that of the blocks of the same size around (Smyth 2004, doi:10.2202/1544-6115.1027).

    Large grids are worked on in parts with a margin, and only where both surveys have points, so that memory and time
    are those of the slope's area and not of the rectangle around it.

    Args:
        reference: (n, 3) points of the first epoch, metres.
        moving: (m, 3) points of the second epoch, registered to the first.
        registration_error: standard error of the registration in height, metres.
        inside: cells (rows, columns) that may be compared; the points of others are left out.
        plants: of each epoch's points, where known.
    """
    progress = progress or Progress()
    progress.update(0.0, "gridding both epochs")
    steps = largest_step(reference, moving, grid.cell, parameters)
    growth = Growth(grid.cell, steps, level_step(grid.cell, parameters), registration_error, parameters)
    heights = np.concatenate([c[:: max(1, len(c) // 10_000), 2] for c in (reference, moving)])
    level = float(np.median(heights)) if heights.size else 0.0
    frame = _Frame.around(grid, 2**steps)
    epochs = tuple(_Points.on(cloud, frame, cover) for cloud, cover in zip((reference, moving), plants, strict=True))
    within = np.ones(frame.grid.shape, dtype=bool) if inside is None else frame.padded(inside, False)
    points = epochs[0].counts(frame, within), epochs[1].counts(frame, within)
    outlines = [_surveyed_cells(epoch, within, 2**steps) for epoch in epochs]
    within &= outlines[0] & outlines[1]
    parts = []
    windows = list(_windows(frame.grid.shape, 2**steps, epochs, within))
    for number, (outer, inner) in enumerate(windows):
        progress.update(0.1 + 0.9 * number / len(windows), f"cells of {grid.cell:g} to {grid.cell * 2**steps:g} m")
        part = frame.part(outer)
        of_part = within[outer]
        moments = []
        for epoch in epochs:
            chosen = epoch.inside(outer)
            moments.append(cell_moments(epoch.xyz[chosen], part, level, [v[chosen] for v in epoch.more]))
            moments[-1].sums[:, ~of_part] = 0.0
        parts.append(_Part.of(grow(moments, of_part, growth, level), outer, inner, frame.grid.columns))
    progress.update(1.0, "cells grown")
    return _together(parts, frame, points, [len(epoch.more) for epoch in epochs])


def surveyed(hit: NDArray[np.bool_], points: int, reach: int) -> NDArray[np.bool_]:
    """Cells (rows, columns) within a survey's outline: those with points, gaps of up to twice ``reach`` cells between
    them, and a rim as wide as points lie apart, in which none came to lie by chance.

    Args:
        hit: cells with points.
        points: how many all cells have.
    """
    outline = _closed(hit, reach)
    rim = int(math.sqrt(outline.sum() / max(points, 1.0)))
    return _closed(hit, reach, rim) if rim else outline


def _closed(cells: NDArray[np.bool_], reach: int, rim: int = 0) -> NDArray[np.bool_]:
    """Cells widened by ``reach`` and ``rim`` and narrowed by ``reach`` again, along rows and columns."""
    margin = reach + rim
    wide = np.pad(cells, margin).astype(np.uint8)
    for axis in (0, 1):
        wide = ndimage.maximum_filter1d(wide, 2 * margin + 1, axis=axis, mode="constant")
    for axis in (0, 1):
        wide = ndimage.minimum_filter1d(wide, 2 * reach + 1, axis=axis, mode="constant", cval=1)
    return wide[margin:-margin, margin:-margin] > 0


@dataclass(frozen=True)
class _Frame:
    """A grid whose edges are multiples of the largest block, and where the given one lies in it."""

    grid: Grid
    top: int
    left: int
    shape: tuple[int, int]

    @classmethod
    def around(cls, grid: Grid, multiple: int) -> _Frame:
        first = round(grid.west / grid.cell) % multiple
        above = -round(grid.north / grid.cell) % multiple
        rows, columns = (-(-(a + b) // multiple) * multiple for a, b in ((above, grid.rows), (first, grid.columns)))
        west, north = grid.west - first * grid.cell, grid.north + above * grid.cell
        return cls(Grid(west, north, grid.cell, rows, columns), above, first, grid.shape)

    def cut(self, array: NDArray) -> NDArray:
        return array[self.top : self.top + self.shape[0], self.left : self.left + self.shape[1]]

    def padded(self, array: NDArray, fill: object) -> NDArray:
        whole = np.full(self.grid.shape, fill, dtype=array.dtype)
        self.cut(whole)[:] = array
        return whole

    def part(self, window: Window) -> Grid:
        """The grid of a window of the frame."""
        rows, columns = window
        return Grid(
            self.grid.west + columns.start * self.grid.cell,
            self.grid.north - rows.start * self.grid.cell,
            self.grid.cell,
            rows.stop - rows.start,
            columns.stop - columns.start,
        )


Window = tuple[slice, slice]


@dataclass(frozen=True)
class _Points:
    """A survey's points within the frame, their rows and columns there, and what else is known of each."""

    xyz: Float
    row: NDArray[np.int32]
    column: NDArray[np.int32]
    more: list[NDArray[np.floating]]

    @classmethod
    def on(cls, cloud: Float, frame: _Frame, cover: PlantCover | None) -> _Points:
        more = [] if cover is None else [cover.error] if cover.height is None else [cover.error, cover.height]
        index = cell_index(cloud, frame.grid)
        if index.size and index.min() < 0:
            known = index >= 0
            index, cloud, more = index[known], cloud[known], [values[known] for values in more]
        row, column = (place.astype(np.int32) for place in np.divmod(index, frame.grid.columns))
        return cls(cloud, row, column, list(more))

    def counts(self, frame: _Frame, within: NDArray[np.bool_]) -> NDArray[np.int32]:
        """Points of each cell of the grid within the frame; of ``within`` (frame's rows, columns) only."""
        row, column = self.row - frame.top, self.column - frame.left
        rows, columns = frame.shape
        here = (row >= 0) & (row < rows) & (column >= 0) & (column < columns) & within[self.row, self.column]
        index = row[here].astype(np.int64) * columns + column[here]
        return np.bincount(index, minlength=rows * columns).astype(np.int32).reshape(frame.shape)

    def inside(self, window: Window) -> NDArray[np.bool_]:
        """Points in a window of the frame."""
        rows, columns = window
        return (
            (self.row >= rows.start)
            & (self.row < rows.stop)
            & (self.column >= columns.start)
            & (self.column < columns.stop)
        )


def _surveyed_cells(epoch: _Points, within: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    hit = np.zeros(within.shape, dtype=bool)
    chosen = within[epoch.row, epoch.column]
    hit[epoch.row[chosen], epoch.column[chosen]] = True
    return surveyed(hit, int(chosen.sum()), reach)


def _windows(
    shape: tuple[int, int], multiple: int, epochs: tuple[_Points, ...], within: NDArray[np.bool_]
) -> Iterator[tuple[Window, Window]]:
    """Windows of the frame to work on, and the part of each that counts; only those in which both surveys have points.

    Their edges are multiples of the largest block. The margin holds the blocks around a block, from which its error
    is estimated.
    """
    rows, columns = shape
    if rows * columns <= _AT_ONCE:
        whole = slice(0, rows), slice(0, columns)
        yield whole, whole
        return
    side, margin = multiple * max(1, _TILE // multiple), multiple * (PRIOR_RADIUS_BLOCKS + 1)
    reached = []
    for epoch in epochs:
        tiles = np.zeros((-(-rows // side), -(-columns // side)), dtype=bool)
        chosen = within[epoch.row, epoch.column]
        tiles[epoch.row[chosen] // side, epoch.column[chosen] // side] = True
        # points in the margin fill blocks of the neighbour only
        reached.append(tiles)
    for i, j in zip(*np.nonzero(reached[0] & reached[1]), strict=True):
        inner = slice(i * side, min((i + 1) * side, rows)), slice(j * side, min((j + 1) * side, columns))
        outer = tuple(
            slice(max(part.start - margin, 0), min(part.stop + margin, end))
            for part, end in zip(inner, shape, strict=True)
        )
        yield (outer[0], outer[1]), inner


@dataclass(frozen=True)
class _Part:
    """What grew in a window: flat indices of the frame's cells in blocks, these blocks, heights; figures of blocks."""

    cell: NDArray[np.int64]
    block: NDArray[np.int64]
    height: Float
    figures: Float

    @classmethod
    def of(cls, grown: Grown, outer: Window, inner: Window, columns: int) -> _Part:
        own = tuple(slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
        block = grown.block[own]
        row, column = np.nonzero(block >= 0)
        number, used = block[row, column], np.zeros(grown.figures.shape[1], dtype=np.int64)
        used[number] = 1
        kept = np.flatnonzero(used)
        used[kept] = np.arange(len(kept))
        cell = (row + inner[0].start) * columns + column + inner[1].start
        return cls(cell, used[number], grown.height[own][row, column], grown.figures[:, kept])


def _together(
    parts: list[_Part], frame: _Frame, points: tuple[NDArray[np.int32], NDArray[np.int32]], known: list[int]
) -> AdaptiveCells:
    """Args: known: how many values of plants each epoch has."""
    figures = np.concatenate([part.figures for part in parts] or [np.zeros((len(COLUMNS), 0))], axis=1)
    nothing = np.zeros(0, dtype=np.int64)
    cell = np.concatenate([nothing, *(part.cell for part in parts)])
    before = np.cumsum([0, *(part.figures.shape[1] for part in parts)])
    block = np.concatenate([nothing, *(part.block + n for part, n in zip(parts, before[:-1], strict=True))])
    height = np.concatenate([nothing.astype(np.float64), *(part.height for part in parts)])
    row, column = np.divmod(cell, frame.grid.columns)
    row, column = row - frame.top, column - frame.left
    rows, columns = frame.shape
    here = np.flatnonzero((row >= 0) & (row < rows) & (column >= 0) & (column < columns))
    # in the order of the cells
    cell = row[here] * columns + column[here]
    order = np.argsort(cell, kind="stable")
    cell, block, height = cell[order], block[here][order], height[here][order]
    # numbers without gaps, in the order of the blocks' first cells
    found, first, number = np.unique(block, return_index=True, return_inverse=True)
    by_first = np.argsort(first, kind="stable")
    figures = figures[:, found[by_first]]
    rank = np.empty(len(found), dtype=np.int64)
    rank[by_first] = np.arange(len(found))
    number = rank[number.ravel()]

    def of_cells(values: NDArray, empty: NDArray | float | np.integer = np.nan) -> NDArray:
        array = np.array(np.broadcast_to(empty, frame.shape))
        array.ravel()[cell] = values
        return array

    by_name = dict(zip(COLUMNS, figures, strict=True))
    dz = by_name["dz"][number]

    def of_plants(name: str, epoch: str, at: int) -> Float | None:
        """``at``: how many values the epoch has at least, where this is known."""
        return of_cells(by_name[f"{name}_{epoch}"][number]) if known[epoch == "to"] > at else None

    plants = [(of_plants("error", epoch, 0), of_plants("height", epoch, 1)) for epoch in ("from", "to")]
    count_from, count_to = (
        of_cells(by_name[f"count_{epoch}"].astype(np.int32)[number], own)
        for epoch, own in zip(("from", "to"), points, strict=True)
    )
    return AdaptiveCells(
        dz=of_cells(dz),
        sampling=of_cells(by_name["sampling"][number]),
        height_from=of_cells(height - dz),
        height_to=of_cells(height),
        slope=of_cells(by_name["slope"][number]),
        count_from=count_from,
        count_to=count_to,
        points=points,
        partition=Partition.of_blocks(
            of_cells(number.astype(np.int32), np.int32(-1)), frame.grid.cell, by_name["side"]
        ),
        plants=together(*plants),
    )
