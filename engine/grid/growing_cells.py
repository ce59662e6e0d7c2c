"""Change in cells that grow where points are few, until their level of detection or a largest size is reached."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...interface.parameters import ChangeParameters
from ...interface.seen import REACH_M
from ..core.arrays import Float
from ..core.progress import Progress
from ..geometry.numbered import united
from ..pointcloud.in_parts import Points, SpooledCloud, every_of
from ..pointcloud.plant_cover import PlantCover
from .block_moments import Moments, cell_moments
from .chosen_cell import largest_step, level_step
from .grid import Grid
from .grown_cells import COLUMNS, Grown, Growth, grow
from .kept_moments import KeptMoments, TiledMoments
from .partition import Partition
from .plant_cells import PlantCells, together
from .seen_cells import Cells, near_ground, near_points
from .stored_tiles import StoredTiles
from .tiled_points import Counted, Frame, Tiled, TiledPoints, Tiles, Window


@dataclass(frozen=True)
class AdaptiveCells:
    """Change in blocks of cells; arrays (n,) of the cells that ``partition`` lists, in which all cells of a block have
    its values. Listed are the cells with points of either epoch and those in a block.

    Attributes:
        dz: change, m; NaN where no block is.
        sampling: standard error of ``dz`` by the points alone, m.
        height_from, height_to: heights of the epochs' planes at the cell's centre, m.
        slope: inclination of the block's planes, degrees.
        count_from, count_to: points of the block in either epoch; outside of blocks, of the cell.
        points: points of each cell itself in either epoch.
        partition: the blocks.
        near: cells of the grid with ground of either survey nearby.
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
    near: tuple[Cells, Cells]
    plants: PlantCells | None = None


def adaptive_cells(
    reference: Points,
    moving: Points,
    grid: Grid,
    parameters: ChangeParameters,
    *,
    registration_error: float = 0.0,
    inside: NDArray[np.bool_] | None = None,
    plants: tuple[PlantCover | None, PlantCover | None] = (None, None),
    progress: Progress | None = None,
) -> AdaptiveCells:
    """Change of each block: the smallest of cell, 2 x 2, 4 x 4 ... cells that meets ``target_level``.

    From the finest size up, a block is taken where both epochs have enough points in it, its gradient is determined,
    and its level of detection is at most ``target_level``, or more the registration's and the plants' than the points',
    so that a larger one would gain little; from the largest size on, whatever the level is. Where that is left to the
    clouds, cells double once more and again for as long as many places have too few points of an epoch
    (``chosen_cell.largest_step``): growth ends where the ground runs out. Where a change is clear, one point less
    suffices and its level may be a quarter of it: a larger block would blur the tip of a cone and the edge of a step,
    and on unchanged ground so clear a change does not come by chance (eight standard errors). What is taken leaves with
    its points: a larger block is what is left of its square, so that the errors of two blocks are independent but for
    the registration. Single cells here and there in a square, less than a quarter of it, are no block: their mean would
    be that of places far apart. They, and what has too few points of its own, get the change of the smallest whole
    square with enough points, whatever its level is; finer blocks in it have used its points as well. At the edge of a
    step a larger one would be of another place. A cell without ground of both surveys nearby
    (``seen_cells.near_points``) is not compared, and its points are in no block. Neither counts a quarter of a block
    without any point, nor what lies outside of either survey, gaps within it aside. Blocks lie at multiples of their
    side whatever the extent of the clouds.

    The surface of a block is a pair of parallel planes (see ``block_moments.parallel_planes``). The variance of a point
    about them is moderated by that of the blocks of the same size around (Smyth 2004, doi:10.2202/1544-6115.1027).

    Large grids are worked on in parts with a margin, and only where both surveys have points, so that memory and time
    are those of the slope's area and not of the rectangle around it.

    Args:
        reference: (n, 3) points of the first epoch, metres.
        moving: (m, 3) points of the second epoch, registered to the first.
        registration_error: standard error of the registration in height, metres.
        inside: cells (rows, columns) that may be compared; the points of others are left out.
        plants: of each epoch's points, where known; those on the disk have their own.
    """
    progress = progress or Progress()
    progress.update(0.0, "gridding both epochs")
    steps = largest_step(reference, moving, grid.cell, parameters)
    growth = Growth(grid.cell, steps, level_step(grid.cell, parameters), registration_error, parameters)
    heights = np.concatenate([every_of(c, max(1, len(c) // 10_000))[:, 2] for c in (reference, moving)])
    level = float(np.median(heights)) if heights.size else 0.0
    frame = Frame.around(grid, 2**steps)
    tiles = Tiles.of(frame.grid.shape, 2**steps)
    epochs = [_tiled(cloud, frame, tiles, cover) for cloud, cover in zip((reference, moving), plants, strict=True)]
    return _grown(epochs, growth, level, inside, progress)


def adaptive_cells_of_moments(
    reference: KeptMoments,
    moving: KeptMoments,
    grid: Grid,
    parameters: ChangeParameters,
    *,
    registration_error: float = 0.0,
    inside: NDArray[np.bool_] | None = None,
    progress: Progress | None = None,
) -> AdaptiveCells:
    """As ``adaptive_cells``, from the sums of both epochs' points in the cells of ``grid``, which a series keeps."""
    first, second = (_middles(kept, grid) for kept in (reference, moving))
    steps = largest_step(first, second, grid.cell, parameters, (reference.points, moving.points))
    growth = Growth(grid.cell, steps, level_step(grid.cell, parameters), registration_error, parameters)
    frame = Frame.around(grid, 2**steps)
    tiles = Tiles.of(frame.grid.shape, 2**steps)
    level = reference.level
    epochs = [TiledMoments.on(kept.from_level(level), frame, tiles) for kept in (reference, moving)]
    return _grown(epochs, growth, level, inside, progress or Progress())


def _middles(kept: KeptMoments, grid: Grid) -> Float:
    row, column = np.divmod(kept.cell, grid.columns)
    west, north = grid.west + (column + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell
    return np.column_stack([west, north, np.zeros(len(row))])


def _grown(
    epochs: Sequence[Tiled | TiledMoments],
    growth: Growth,
    level: float,
    inside: NDArray[np.bool_] | None,
    progress: Progress,
) -> AdaptiveCells:
    """Args: level: of the heights, m."""
    frame, tiles, multiple = epochs[0].frame, epochs[0].tiles, 2**growth.steps
    within = np.ones(frame.grid.shape, dtype=bool) if inside is None else frame.padded(inside, False)
    points = [epoch.counts(within) for epoch in epochs]
    outlines = [_surveyed_cells(epoch, within, multiple) for epoch in epochs]
    near = [_near_ground(epoch, within) for epoch in epochs]
    kept = Cells.of(frame.cut(near[0])), Cells.of(frame.cut(near[1]))
    within &= outlines[0] & outlines[1] & near[0] & near[1]
    del outlines, near
    parts = []
    windows = list(tiles.windows(epochs, within))
    for number, (outer, inner) in enumerate(windows):
        largest = growth.cell * multiple
        progress.update(0.1 + 0.9 * number / len(windows), f"cells of {growth.cell:g} to {largest:g} m")
        part = frame.part(outer)
        of_part = within[outer]
        moments = [_moments(epoch, outer, part, level) for epoch in epochs]
        for epoch_moments in moments:
            epoch_moments.sums[:, ~of_part] = 0.0
        parts.append(_Part.of(grow(moments, of_part, growth, level), outer, inner, frame.grid.columns))
    progress.update(1.0, "cells grown")
    return _together(parts, frame, points, [epoch.known for epoch in epochs], kept)


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
    return wide[margin : margin + cells.shape[0], margin : margin + cells.shape[1]] > 0


def _tiled(cloud: Points, frame: Frame, tiles: Tiles, cover: PlantCover | None) -> Tiled:
    if isinstance(cloud, SpooledCloud):
        return StoredTiles.on(cloud, frame, tiles)
    return TiledPoints.on(cloud, frame, tiles, cover)


def _surveyed_cells(epoch: Tiled | TiledMoments, within: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    return surveyed(*epoch.hit(within), reach)


def _near_ground(epoch: Tiled | TiledMoments, within: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells of the frame (rows, columns) with ground of the survey nearby, of what is ``within``."""
    frame, tiles = epoch.frame, epoch.tiles
    found = np.zeros(frame.grid.shape, dtype=bool)
    for number in range(tiles.count):
        inner = tiles.window(number)
        outer = tiles.widened(inner, math.ceil(REACH_M / frame.grid.cell) + 1)
        if not any(epoch.reaches(tile, within) for tile in tiles.near(outer)):
            continue
        part = frame.part(outer)
        if isinstance(epoch, TiledMoments):
            near = near_ground(epoch.moments(outer, part))
        else:
            near = np.zeros(part.shape, dtype=bool)
            for xyz, _ in epoch.inside(outer):
                near |= near_points(xyz, part)
        found[inner] = near[tuple(slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer))]
    return found


def _moments(epoch: Tiled | TiledMoments, window: Window, grid: Grid, level: float) -> Moments:
    """Of the survey's points in the cells of a window of the frame, whose grid is ``grid``."""
    if isinstance(epoch, TiledMoments):
        return epoch.moments(window, grid)
    found: Moments | None = None
    for xyz, more in epoch.inside(window):
        of_part = cell_moments(xyz, grid, level, more)
        if found is None:
            found = of_part
        else:
            found.sums[:] += of_part.sums
    return found or cell_moments(np.zeros((0, 3)), grid, level, [np.zeros(0)] * epoch.known)


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
    parts: list[_Part], frame: Frame, points: Sequence[Counted], known: list[int], near: tuple[Cells, Cells]
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
    listed = united(points[0][0], points[1][0], cell)
    place = np.searchsorted(listed, cell)
    by_name = dict(zip(COLUMNS, figures, strict=True))

    def of_cells(values: NDArray, empty: NDArray | float | np.integer = np.nan) -> NDArray:
        array = np.array(np.broadcast_to(empty, listed.shape))
        array[place] = values
        return array

    def of_plants(name: str, epoch: str, at: int) -> Float | None:
        """``at``: how many values the epoch has at least, where this is known."""
        return of_cells(by_name[f"{name}_{epoch}"][number]) if known[epoch == "to"] > at else None

    own = [np.zeros(listed.size, dtype=np.int32) for _ in points]
    for count, (with_points, values) in zip(own, points, strict=True):
        count[np.searchsorted(listed, with_points)] = values
    dz = by_name["dz"][number]
    plants = [(of_plants("error", epoch, 0), of_plants("height", epoch, 1)) for epoch in ("from", "to")]
    count_from, count_to = (
        of_cells(by_name[f"count_{epoch}"].astype(np.int32)[number], counted)
        for epoch, counted in zip(("from", "to"), own, strict=True)
    )
    blocks = of_cells(number.astype(np.int32), np.int32(-1))
    return AdaptiveCells(
        dz=of_cells(dz),
        sampling=of_cells(by_name["sampling"][number]),
        height_from=of_cells(height - dz),
        height_to=of_cells(height),
        slope=of_cells(by_name["slope"][number]),
        count_from=count_from,
        count_to=count_to,
        points=(own[0], own[1]),
        partition=Partition(frame.shape, frame.grid.cell, blocks, by_name["side"], listed),
        near=near,
        plants=together(*plants),
    )
