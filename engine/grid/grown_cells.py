"""Squares of cells that grow over the sums of their points: which size each place gets, and its change there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...interface.parameters import ChangeParameters
from ..core.arrays import Float
from ..statistics.normal import quantile
from .block_moments import Moments, ParallelPlanes, merged, parallel_planes, variance_by_parts
from .chosen_cell import MIN_POINTS

MAX_CLEAR_LEVEL_SHARE, MIN_CLEAR_POINTS = 0.25, 3
"""A change is clear where its level of detection is at most this share of it; its blocks take so many points."""
PRIOR_RADIUS_BLOCKS = 3
"""Blocks around one, whose variance is its prior."""
_PRIOR_DEGREES = 8.0  # of freedom that the surrounding blocks' variance counts
_PART_LEVELS = 2  # a block is compared with its parts of a quarter of its side
_PLANE_PARTS = 3.0  # parts that the fit of the planes takes from their number; measured with independent points
_PRIOR_PARTS = 4.0  # weight of independence, in parts, compared with theirs
_MIN_LEFT_SHARE = 0.25  # of a square's cells: what is left of it to less than that is no place of its own
COLUMNS = (
    "dz", "sampling", "slope", "count_from", "count_to", "side", "error_from", "height_from", "error_to", "height_to",
)  # fmt: skip
"""Figures of a block: change, its standard error by the points, inclination, points, side; mean error and height
of the plants in either epoch."""


@dataclass(frozen=True)
class Growth:
    """How cells grow: ``steps`` doublings of ``cell`` (m), from ``enough`` on whatever the level of detection is."""

    cell: float
    steps: int
    enough: int
    registration_error: float
    parameters: ChangeParameters


@dataclass(frozen=True)
class Grown:
    """The block of each cell (rows, columns), -1 for none; the height of the later epoch's plane at its centre, m; and
    the figures of the blocks, (``COLUMNS``, blocks).
    """

    block: NDArray[np.int64]
    height: Float
    figures: Float


def grow(moments: list[Moments], within: NDArray[np.bool_], growth: Growth, level: float) -> Grown:
    """Blocks of the cells ``within`` (rows, columns), from the finest size up (see ``growing_cells.adaptive_cells``).

    Args:
        moments: of both epochs, heights from ``level``, with nothing outside of ``within``; rows and columns are
            multiples of the largest block. They are used up.
    """
    result = _Result.empty(within.copy(), growth.cell, level)
    squares: list[_Squares] = []
    for step in range(growth.steps + 1):
        squares.append(_Squares.of_points(moments) if not step else squares[-1].merged(squares[-_PART_LEVELS:][0]))
    left: list[list[Moments]] = []
    for step in range(growth.steps + 1):
        reached = _reached(left[-1]) if step else None
        left.append([merged(m) for m in left[-1]] if step else moments)
        planes, sampling = squares[0].planes, squares[0].sampling
        if step:
            planes = parallel_planes(*left[step])
            parts = left[step - _PART_LEVELS] if step >= _PART_LEVELS else None
            sampling = _sampling_error(planes, squares[step].planes, left[step], parts)
        taken = _serve(planes, sampling, left[step], growth, step)
        taken &= _filled(result.unclaimed, 2**step) >= _MIN_LEFT_SHARE * _filled(within, 2**step)
        result.take(taken, planes, sampling, left[step], reached)
        for back in range(min(step + 1, _PART_LEVELS)):
            for epoch in left[step - back]:
                epoch.sums[:, _spread(taken, 2**back)] = 0.0
    for whole in squares[1:]:
        # as near as can be, whatever the level is: a larger square lies on both sides of an edge
        taken = _serve(whole.planes, whole.sampling, whole.moments, growth, growth.enough)
        result.take(taken, whole.planes, whole.sampling, whole.moments, whole.reached)
    return Grown(result.block, result.height, np.concatenate(result.figures, axis=1))


def _serve(
    planes: ParallelPlanes, sampling: Float, moments: list[Moments], growth: Growth, step: int
) -> NDArray[np.bool_]:
    """Blocks that are large enough."""
    parameters = growth.parameters
    # what no larger cell averages out
    shared = np.hypot(growth.registration_error, _plant_error(moments))
    fewest = np.minimum(moments[0].count, moments[1].count)
    usable = planes.sound & np.isfinite(sampling) & (fewest >= parameters.minimum_points)
    enough = fewest >= MIN_POINTS
    with np.errstate(invalid="ignore"):
        level = quantile(parameters.confidence) * np.hypot(sampling, shared)
        if step < growth.enough:
            enough &= (level <= parameters.target_level) | (sampling <= shared)
        enough |= (fewest >= MIN_CLEAR_POINTS) & (level <= MAX_CLEAR_LEVEL_SHARE * np.abs(planes.dz))
    return usable & enough


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
            free = np.maximum(number - _PLANE_PARTS, 0.0)
            effect = np.where(free > 0, by_parts * number / np.where(free > 0, free, 1.0) / of_means, 1.0)
            variance *= np.maximum((free * effect + _PRIOR_PARTS) / (free + _PRIOR_PARTS), 1.0)
        return np.sqrt(variance)


def _surrounding_variance(squares: Float, degrees: Float) -> Float:
    """Variance of a point by the blocks around, all together where there are too few of them."""
    size = 2 * PRIOR_RADIUS_BLOCKS + 1
    sums = np.nan_to_num(np.stack([squares, degrees]))
    near = ndimage.uniform_filter(sums, (1, size, size), mode="constant") * size**2
    total = sums[1].sum()
    whole = sums[0].sum() / total if total > 0 else np.nan
    enough = near[1] >= 0.5
    return np.where(enough, np.maximum(near[0], 0.0) / np.where(enough, near[1], 1.0), whole)


@dataclass
class _Result:
    """What has been taken so far: the block of each cell, and the blocks' figures; heights from ``level``."""

    block: NDArray[np.int64]
    height: Float
    figures: list[Float]
    cell: float
    unclaimed: NDArray[np.bool_]
    level: float

    @classmethod
    def empty(cls, unclaimed: NDArray[np.bool_], cell: float, level: float) -> _Result:
        block = np.full(unclaimed.shape, -1, dtype=np.int64)
        return cls(block, np.full(unclaimed.shape, np.nan), [], cell, unclaimed, level)

    def take(
        self,
        taken: NDArray[np.bool_],
        planes: ParallelPlanes,
        sampling: Float,
        moments: list[Moments],
        reached: NDArray[np.bool_] | None,
    ) -> None:
        """Give the cells of the blocks ``taken`` that no finer one has, where a quarter has points, to these."""
        multiple = round(moments[0].side / self.cell)
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
        east = (column - (j * multiple + (multiple - 1) / 2)) * self.cell
        north = ((i * multiple + (multiple - 1) / 2) - row) * self.cell
        self.height[row, column] = middle[i, j] + planes.slope_u[i, j] * east + planes.slope_v[i, j] * north
        slope = np.degrees(np.arctan(np.hypot(planes.slope_u, planes.slope_v)))
        side = np.full(taken.shape, moments[0].side)
        columns = (planes.dz, sampling, slope, moments[0].count, moments[1].count, side, *_plants_of(moments))
        self.figures.append(np.stack([c[taken] for c in columns]))


def _spread(blocks: NDArray, multiple: int) -> NDArray:
    """Each block's value on its ``multiple`` by ``multiple`` cells."""
    return np.repeat(np.repeat(blocks, multiple, axis=0), multiple, axis=1)
