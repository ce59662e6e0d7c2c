"""What the last survey knows of the ground of the next one: how many pulses reach it, and how its returns scatter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage, stats
from shapely import MultiPolygon, Polygon

from ..core.arrays import Float, Index
from ..grid.grid import Grid, cell_index

CLUMP_M = 0.4
"""Side (m) of the patches over which the density of ground returns under plants varies."""
SCATTER_SIDES_M = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8)
"""Sides of the squares in which the scatter of ground returns about a plane is measured."""
_MIN_SCATTER_POINTS, _MIN_SCATTER_SQUARES = 8, 20
_MIN_PULSES = 20  # of a place, below which the places around are counted as well
_DEFAULT_SCATTER_M = 0.03


@dataclass(frozen=True)
class Scatter:
    """Standard deviation of ground returns about a plane, ``deviation`` (k,) metres, by ``side`` (k,) of the square."""

    side: tuple[float, ...]
    deviation: tuple[float, ...]

    def at(self, side: float) -> float:
        """In squares of ``side`` m: interpolated over the logarithm of the side, constant beyond what was measured."""
        return float(np.interp(math.log(side), np.log(self.side), self.deviation))


@dataclass(frozen=True)
class Seen:
    """The last survey in each place (rows, columns): pulses, and the share of them with a return of the ground, NaN
    where it had too few; ``clumping`` of its ground returns, the variance of their density within the place in squares
    of its mean; ``plant_error`` of their heights, metres, 0 where it is not known; ``returns_a_pulse`` of the whole.
    """

    pulses: Index
    ground_share: Float
    clumping: Float
    plant_error: Float
    returns_a_pulse: float


def even_scatter(deviation: float | None) -> Scatter:
    """The same in squares of every size; 0.03 m where it is not given."""
    return Scatter((1.0,), (_DEFAULT_SCATTER_M if deviation is None else deviation,))


def scatter_within(xyz: Float, region: Polygon | MultiPolygon) -> Scatter | None:
    """``scatter_of`` the ground returns (n, 3) in a region, as ground around it may be smoother or rougher; of all
    where the region has too few.
    """
    inside = shapely.contains_xy(region, xyz[:, 0], xyz[:, 1])
    return scatter_of(xyz[inside]) or scatter_of(xyz)


def scatter_of(xyz: Float) -> Scatter | None:
    """Scatter of ground returns (n, 3) about planes, the median over squares with at least 8 returns, by their side.

    None where too few squares have so many.
    """
    sides, deviations = [], []
    if not len(xyz):
        return None
    for side in SCATTER_SIDES_M:
        variance = _plane_variances(xyz, side)
        if len(variance) >= _MIN_SCATTER_SQUARES:
            sides.append(side)
            deviations.append(math.sqrt(float(np.median(variance))))
    return Scatter(tuple(sides), tuple(deviations)) if sides else None


def _plane_variances(xyz: Float, side: float) -> Float:
    """Variance about the plane of each square with enough points, with three degrees of freedom less than points.

    Divided by the median of chi-squared over its degrees, so that their median is that of what they estimate.
    """
    corner = np.floor(xyz[:, :2] / side)
    low = corner.min(axis=0)
    place = ((corner - low) @ np.array([corner[:, 1].max() - low[1] + 1.0, 1.0])).astype(np.int64)
    _, square, count = np.unique(place, return_inverse=True, return_counts=True)
    chosen = (count >= _MIN_SCATTER_POINTS)[square]
    if not chosen.any():
        return np.empty(0)
    _, square = np.unique(square[chosen], return_inverse=True)
    number = int(square.max()) + 1
    middle = (corner[chosen] + 0.5) * side
    x, y = ((xyz[chosen, :2] - middle) / side).T
    z = xyz[chosen, 2] - np.median(xyz[:, 2])
    z = z - (np.bincount(square, z, number) / np.bincount(square, minlength=number))[square]

    def total(values: Float) -> Float:
        return np.asarray(np.bincount(square, values, number), dtype=np.float64)

    one = np.ones(len(x))
    columns = (one, x, y)
    normal = np.stack([np.stack([total(a * b) for b in columns], axis=-1) for a in columns], axis=-2)
    right = np.stack([total(a * z) for a in columns], axis=-1)
    sound = np.linalg.det(normal) > 1e-6 * normal[:, 0, 0] ** 3 * 1e-2
    solution = np.linalg.solve(normal[sound], right[sound][:, :, None])[:, :, 0]
    squares = total(z**2)[sound] - (solution * right[sound]).sum(axis=1)
    return np.maximum(squares, 0.0) / stats.chi2.median(normal[sound, 0, 0] - 3)


def seen_by(grid: Grid, first: Float, ground: Float, returns: int, plant_error: Float | None = None) -> Seen:
    """What a survey shows of each place of ``grid``.

    Places with fewer than 20 pulses are counted with those around, three by three and so on up to nine by nine.

    Args:
        first: (n, 2+) places of the first returns, one a pulse.
        ground: (m, 2+) of the ground returns.
        returns: number of all returns in the file.
        plant_error: (m,) of the ground returns, metres; None where it is not known.
    """
    pulses, hits = (_counts(points, grid) for points in (first, ground))
    share, summed = np.full(grid.shape, np.nan), pulses.astype(float)
    for size in (1, 3, 5, 9):
        around = [ndimage.uniform_filter(c.astype(float), size, mode="constant") * size**2 for c in (pulses, hits)]
        summed = np.rint(around[0])
        fill = np.isnan(share) & (summed >= _MIN_PULSES)
        share[fill] = np.minimum(np.rint(around[1][fill]) / summed[fill], 1.0)
    error = np.zeros(grid.shape)
    if plant_error is not None:
        place = cell_index(ground, grid)
        inside = place >= 0
        total = np.bincount(place[inside], plant_error[inside], grid.rows * grid.columns).reshape(grid.shape)
        error = total / np.maximum(hits, 1)
    return Seen(pulses, share, clumping_of(grid, ground), error, returns / max(len(first), 1))


def clumping_of(grid: Grid, ground: Float) -> Float:
    """How much the density of ground returns varies within each place and those around it (rows, columns), beyond what
    chance makes: (variance - mean) / mean^2 of the counts of patches of about 0.4 m; 0 where there are none.
    """
    many = max(1, round(grid.cell / CLUMP_M))
    fine = Grid(grid.west, grid.north, grid.cell / many, grid.rows * many, grid.columns * many)
    counts = _counts(ground, fine).astype(float).reshape(grid.rows, many, grid.columns, many)
    mean, square = counts.mean(axis=(1, 3)), (counts**2).mean(axis=(1, 3))
    mean, square = (ndimage.uniform_filter(a, 3, mode="nearest") for a in (mean, square))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(mean > 0, np.maximum((square - mean**2 - mean) / mean**2, 0.0), 0.0))


def _counts(xy: Float, grid: Grid) -> Index:
    place = cell_index(xy, grid)
    return np.bincount(place[place >= 0], minlength=grid.rows * grid.columns).reshape(grid.shape)
