"""Change in cells that grow where points are few, until their level of detection or a largest size is reached."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .chosen_cell import LEAST_POINTS, largest_step, level_step
from .gridding import Float, Grid
from .moments import Moments, ParallelPlanes, cell_moments, merged, parallel_planes, variance_by_parts
from .parameters import ChangeParameters
from .plant_cover import PlantCells, PlantCover, together
from .progress import Progress

CLEAR, FEWEST_OF_CLEAR = 0.25, 3
"""A change is clear where its level of detection is at most this share of it; its blocks take so many points."""
_PRIOR_DEGREES = 8.0  # of freedom that the surrounding blocks' variance counts
_RADIUS = 3  # blocks, of the surroundings
_PARTS = 2  # a block is compared with its parts of a quarter of its side
_SPENT = 3.0  # parts that the fit of the planes takes from their number; measured with independent points
_PRIOR_PARTS = 4.0  # what independence counts beside them
_SCATTERED = 0.25  # of a square's cells: what is left of it to less than that is no place of its own


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
        block: number of the block, from 0; -1 outside of blocks.
        cell_size: side of the block, m; NaN outside.
        plants: what plants do to the heights, and how high they stand; None where nothing is known of them.
    """

    dz: Float
    sampling: Float
    height_from: Float
    height_to: Float
    slope: Float
    count_from: NDArray[np.int64]
    count_to: NDArray[np.int64]
    points: tuple[NDArray[np.int64], NDArray[np.int64]]
    block: NDArray[np.int64]
    cell_size: Float
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

    The surface of a block is a pair of parallel planes (see ``moments.parallel_planes``). The variance of a point about
    them is moderated by that of the blocks of the same size around (Smyth 2004, doi:10.2202/1544-6115.1027).

    Args:
        reference: (n, 3) points of the first epoch, metres.
        moving: (m, 3) points of the second epoch, registered to the first.
        registration_error: standard error of the registration in height, metres.
        inside: cells (rows, columns) that may be compared; the points of others are left out.
        plants: of each epoch's points, where known.
    """
    progress = progress or Progress()
    enough_to_reach = level_step(grid.cell, parameters)
    steps = largest_step(reference, moving, grid.cell, parameters)
    heights = np.concatenate([c[:: max(1, len(c) // 10_000), 2] for c in (reference, moving)])
    level = float(np.median(heights)) if heights.size else 0.0
    frame = _Frame.around(grid, 2**steps)
    within = np.ones(frame.grid.shape, dtype=bool) if inside is None else frame.padded(inside, False)
    moments: list[Moments] = []
    for number, (cloud, cover) in enumerate(zip((reference, moving), plants, strict=True)):
        progress.update(0.25 * number, f"gridding epoch {number + 1}")
        more = [] if cover is None else [cover.error] if cover.height is None else [cover.error, cover.height]
        moments.append(cell_moments(cloud, frame.grid, level, more))
        moments[-1].sums[:, ~within] = 0.0
    points = frame.cut(moments[0].count).astype(np.int64), frame.cut(moments[1].count).astype(np.int64)
    for epoch in moments:
        within &= surveyed(epoch.count, 2**steps)
    for epoch in moments:
        epoch.sums[:, ~within] = 0.0
    result = _Result.empty(frame.grid, within.copy(), level)
    quantile = NormalDist().inv_cdf((1 + parameters.confidence) / 2)

    def serves(planes: ParallelPlanes, sampling: Float, moments: list[Moments], last: bool) -> NDArray[np.bool_]:
        # what no larger cell averages out
        shared = np.hypot(registration_error, _plant_error(moments))
        fewest = np.minimum(moments[0].count, moments[1].count)
        usable = planes.sound & np.isfinite(sampling) & (fewest >= parameters.minimum_points)
        enough = fewest >= LEAST_POINTS
        with np.errstate(invalid="ignore"):
            level = quantile * np.hypot(sampling, shared)
            if not last:
                enough &= (level <= parameters.target_level) | (sampling <= shared)
            enough |= (fewest >= FEWEST_OF_CLEAR) & (level <= CLEAR * np.abs(planes.dz))
        return usable & enough

    sizes = [f"cells of {grid.cell * 2**step:g} m" for step in range(steps + 1)]
    squares: list[_Squares] = []
    for step, name in enumerate(sizes):
        progress.update(0.5 + 0.25 * step / len(sizes), name)
        squares.append(_Squares.of_points(moments) if not step else squares[-1].merged(squares[-_PARTS:][0]))
    left: list[list[Moments]] = []
    for step, name in enumerate(sizes):
        progress.update(0.75 + 0.25 * step / len(sizes), name)
        reached = _reached(left[-1]) if step else None
        left.append([merged(m) for m in left[-1]] if step else moments)
        planes, sampling = squares[0].planes, squares[0].sampling
        if step:
            planes = parallel_planes(*left[step])
            parts = left[step - _PARTS] if step >= _PARTS else None
            sampling = _sampling_error(planes, squares[step].planes, left[step], parts)
        taken = serves(planes, sampling, left[step], step >= enough_to_reach)
        taken &= _filled(result.unclaimed, 2**step) >= _SCATTERED * _filled(within, 2**step)
        result.take(taken, planes, sampling, left[step], reached)
        for back in range(min(step + 1, _PARTS)):
            for epoch in left[step - back]:
                epoch.sums[:, _spread(taken, 2**back)] = 0.0
    for step, whole in enumerate(squares[1:], 1):
        taken = serves(whole.planes, whole.sampling, whole.moments, step >= enough_to_reach)
        result.take(taken, whole.planes, whole.sampling, whole.moments, whole.reached)
    progress.update(1.0, "cells grown")
    return result.cells(frame, points, [m.more for m in moments])


def _plants_of(moments: list[Moments]) -> list[Float]:
    """Mean error and height of the plants over each block's points, of the first and then the second epoch; NaN where
    they are not known.
    """
    unknown = np.full(moments[0].shape, np.nan)
    return [m.mean(k) if k < m.more else unknown for m in moments for k in (0, 1)]


def _plant_error(moments: list[Moments]) -> Float | float:
    """Of the change of each block, metres; 0 where it is not known."""
    squares = [np.nan_to_num(m.mean(0)) ** 2 for m in moments if m.more]
    return np.sqrt(sum(squares, np.zeros(moments[0].shape))) if squares else 0.0


def _reached(moments: list[Moments]) -> NDArray[np.bool_]:
    """Blocks with a point of either epoch."""
    return (moments[0].count > 0) | (moments[1].count > 0)


def surveyed(count: Float, reach: int) -> NDArray[np.bool_]:
    """Cells (rows, columns) within a survey's outline: those with points, gaps of up to twice ``reach`` cells between
    them, and a rim as wide as points lie apart, in which none came to lie by chance.

    Args:
        count: points in each cell.
    """
    hit = count > 0
    outline = _closed(hit, reach)
    rim = int(math.sqrt(outline.sum() / max(count.sum(), 1.0)))
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


def _filled(cells: NDArray[np.bool_], multiple: int) -> Float:
    """Share of each block's cells that are set."""
    rows, columns = cells.shape
    return cells.reshape(rows // multiple, multiple, columns // multiple, multiple).mean(axis=(1, 3))


@dataclass(frozen=True)
class _Squares:
    """Squares of one size with all their points, and which of their quarters have any."""

    moments: list[Moments]
    planes: ParallelPlanes
    sampling: Float
    reached: NDArray[np.bool_] | None

    @classmethod
    def of_points(cls, moments: list[Moments]) -> _Squares:
        planes = parallel_planes(*moments)
        return cls(moments, planes, _sampling_error(planes, planes, moments, None), None)

    def merged(self, finer: _Squares) -> _Squares:
        """Those of twice the side; ``finer`` are the squares a quarter of that, or these themselves at the start."""
        moments = [merged(m) for m in self.moments]
        planes = parallel_planes(*moments)
        parts = None if finer is self else finer.moments
        return _Squares(moments, planes, _sampling_error(planes, planes, moments, parts), _reached(self.moments))


def _sampling_error(
    planes: ParallelPlanes, around: ParallelPlanes, moments: list[Moments], parts: list[Moments] | None
) -> Float:
    """Standard error of the blocks' dz by their points, m, widened where the errors of near points are alike."""
    variance, of_means = np.zeros(planes.dz.shape), np.zeros(planes.dz.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        for epoch in (0, 1):
            prior = _surrounding_variance(around.squares[epoch], around.degrees[epoch])
            squares, degrees = planes.squares[epoch], planes.degrees[epoch]
            of_a_point = (squares + _PRIOR_DEGREES * prior) / (degrees + _PRIOR_DEGREES)
            variance += planes.weights[epoch] * of_a_point
            of_means += of_a_point / moments[epoch].count
        if parts is not None:
            by_parts, number = variance_by_parts(planes, moments, parts)
            free = np.maximum(number - _SPENT, 0.0)
            effect = np.where(free > 0, by_parts * number / np.where(free > 0, free, 1.0) / of_means, 1.0)
            variance *= np.maximum((free * effect + _PRIOR_PARTS) / (free + _PRIOR_PARTS), 1.0)
        return np.sqrt(variance)


def _surrounding_variance(squares: Float, degrees: Float) -> Float:
    """Variance of a point by the blocks around, all together where there are too few of them."""
    size = 2 * _RADIUS + 1
    sums = np.nan_to_num(np.stack([squares, degrees]))
    near = ndimage.uniform_filter(sums, (1, size, size), mode="constant") * size**2
    total = sums[1].sum()
    whole = sums[0].sum() / total if total > 0 else np.nan
    enough = near[1] >= 0.5
    return np.where(enough, np.maximum(near[0], 0.0) / np.where(enough, near[1], 1.0), whole)


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


@dataclass
class _Result:
    """What has been taken so far: the block of each cell, and the blocks' figures; heights from ``level``."""

    block: NDArray[np.int64]
    height: Float
    figures: list[Float]
    grid: Grid
    unclaimed: NDArray[np.bool_]
    level: float

    @classmethod
    def empty(cls, grid: Grid, unclaimed: NDArray[np.bool_], level: float) -> _Result:
        block = np.full(grid.shape, -1, dtype=np.int64)
        return cls(block, np.full(grid.shape, np.nan), [], grid, unclaimed, level)

    def take(
        self,
        taken: NDArray[np.bool_],
        planes: ParallelPlanes,
        sampling: Float,
        moments: list[Moments],
        reached: NDArray[np.bool_] | None,
    ) -> None:
        """Give the cells of the blocks ``taken`` that no finer one has, where a quarter has points, to these."""
        multiple = round(moments[0].side / self.grid.cell)
        known = sum(f.shape[1] for f in self.figures)
        number = np.full(taken.shape, -1, dtype=np.int64)
        number[taken] = known + np.arange(np.count_nonzero(taken))
        cells = _spread(number, multiple)
        claimed = self.unclaimed & (cells >= 0)
        if reached is not None:
            claimed &= _spread(reached, multiple // 2)
        self.block[claimed] = cells[claimed]
        self.unclaimed[claimed] = False
        sums = moments[1].sums
        with np.errstate(invalid="ignore", divide="ignore"):
            # the second epoch's plane at the block's centre
            middle = (sums[3] - planes.slope_u * sums[1] - planes.slope_v * sums[2]) / sums[0] + self.level
        row, column = np.nonzero(claimed)
        i, j = row // multiple, column // multiple
        east = (column - (j * multiple + (multiple - 1) / 2)) * self.grid.cell
        north = ((i * multiple + (multiple - 1) / 2) - row) * self.grid.cell
        self.height[row, column] = middle[i, j] + planes.slope_u[i, j] * east + planes.slope_v[i, j] * north
        slope = np.degrees(np.arctan(np.hypot(planes.slope_u, planes.slope_v)))
        side = np.full(taken.shape, moments[0].side)
        columns = (planes.dz, sampling, slope, moments[0].count, moments[1].count, side, *_plants_of(moments))
        self.figures.append(np.stack([c[taken] for c in columns]))

    def cells(
        self, frame: _Frame, points: tuple[NDArray[np.int64], NDArray[np.int64]], known: list[int]
    ) -> AdaptiveCells:
        """Args: known: how many values of plants each epoch has."""
        figures = np.concatenate(self.figures, axis=1)
        block = frame.cut(self.block)
        inside = block >= 0
        # numbers without gaps, in the order of the blocks' first cells
        found, first, cells = np.unique(block[inside], return_index=True, return_inverse=True)
        order = np.argsort(first, kind="stable")
        figures = figures[:, found[order]]
        rank = np.empty(len(found), dtype=np.int64)
        rank[order] = np.arange(len(found))
        block = np.full(block.shape, -1, dtype=np.int64)
        block[inside] = rank[cells.ravel()]

        def of_cells(values: Float) -> Float:
            array = np.full(block.shape, np.nan)
            array[inside] = values[block[inside]]
            return array

        dz, sampling, slope, _, _, side = (of_cells(values) for values in figures[:6])
        plants = [
            (of_cells(figures[at]) if number else None, of_cells(figures[at + 1]) if number > 1 else None)
            for at, number in zip((6, 8), known, strict=True)
        ]
        count_from, count_to = (
            np.where(inside, np.nan_to_num(of_cells(values)).astype(np.int64), own)
            for values, own in zip(figures[3:5], points, strict=True)
        )
        height = np.where(inside, frame.cut(self.height), np.nan)
        return AdaptiveCells(
            dz,
            sampling,
            height - dz,
            height,
            slope,
            count_from,
            count_to,
            points,
            block,
            side,
            together(plants[0], plants[1]),
        )


def _spread(blocks: NDArray, multiple: int) -> NDArray:
    """Each block's value on its ``multiple`` by ``multiple`` cells."""
    return np.repeat(np.repeat(blocks, multiple, axis=0), multiple, axis=1)
