"""Difference of two epochs on a common grid, with its error and level of detection."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import geometry_mask
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from .cell_slope import slope_degrees, slope_gradient
from .errors import InputError
from .gridding import CellStatistics, Float, Grid, cell_statistics, snapped_grid
from .parameters import ChangeParameters
from .progress import Progress

# Degrees of freedom that the neighbourhood's variance counts beside the cell's own (see pooled_variance).
_PRIOR_DEGREES = 8.0
_FEWEST_CELLS = 30  # with fewer in common, nothing can be said of the whole overlap
_BYTES_A_CELL = 180.0  # measured peak of difference() and what follows it, per cell of the grid


@dataclass(frozen=True)
class Change:
    """Elevation change B minus A; arrays of shape ``grid.shape``, NaN where a cell is not valid in both epochs.

    ``error`` is the standard error of ``dz``; ``level`` the level of detection at ``confidence``, both in metres.
    ``common_cell_rate`` is the share of cells valid in both epochs among those valid in either. ``stable`` marks the
    cells that were taken as stable ground; ``slope`` is the surface's inclination, degrees, NaN where it is unknown.
    """

    grid: Grid
    dz: Float
    error: Float
    level: Float
    significant: NDArray[np.bool_]
    count_from: NDArray[np.int64]
    count_to: NDArray[np.int64]
    height_from: Float
    height_to: Float
    confidence: float
    registration_error: float
    common_cell_rate: float
    uniform_dz: float | None
    stable: NDArray[np.bool_]
    slope: Float
    minimum_points: int = 1

    @property
    def valid(self) -> NDArray[np.bool_]:
        return np.isfinite(self.dz)

    @property
    def median_level(self) -> float:
        return float(np.nanmedian(self.level))


def common_grid(reference: Float, moving: Float, parameters: ChangeParameters) -> Grid:
    """The snapped grid that covers both clouds ((n, 3) and (m, 3)) where their extents meet.

    Raises:
        InputError: the extents do not meet (both are named), or the grid needs more than ``memory_limit``.
    """
    extents = [(*c[:, :2].min(axis=0).tolist(), *c[:, :2].max(axis=0).tolist()) for c in (reference, moving)]
    a, b = extents
    meet = (max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3]))
    if meet[0] > meet[2] or meet[1] > meet[3]:
        raise InputError(
            f"The epochs do not overlap: the first spans {_extent(a)}, the second {_extent(b)}; "
            "check that both are of the same slope and in the same reference system."
        )
    union = (min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3]))
    grid = snapped_grid(union, parameters.cell)
    limit = parameters.memory_limit * 1e9
    if _bytes(grid) > limit:
        raise InputError(
            f"A grid of {grid.rows} by {grid.columns} cells needs {_bytes(grid) / 1e9:.3g} GB, more than the "
            f"{parameters.memory_limit:g} GB allowed; clip to the slope or use a cell of at least "
            f"{_cell_that_fits(union, parameters.cell, limit):g} m."
        )
    return grid


def difference(
    reference: Float,
    moving: Float,
    parameters: ChangeParameters,
    *,
    registration_error: float = 0.0,
    area: BaseGeometry | None = None,
    progress: Progress | None = None,
) -> Change:
    """Grid both clouds and subtract: change, standard error and level of detection of each cell.

    The error of a cell's height is its points' variance times the leverage (1/n for a mean); the difference adds
    both epochs' and the registration error in quadrature (Lague et al. 2013, doi:10.1016/j.isprsjprs.2013.04.009,
    eq. 1, with the registration error as a standard error). The level is the two-sided normal quantile times that.

    Args:
        reference: (n, 3) points of the first epoch, metres.
        moving: (m, 3) points of the second epoch, registered to the first.
        registration_error: standard error of the registration in height, metres; ``parameters.registration_error``
            overrides it unless negative.
        area: polygons to which both clouds were clipped. Cells that are not wholly inside hold a part of their
            surface only, not the same in both epochs, and are left out.

    Raises:
        InputError: no overlap, no common cell, no cell with two points, or a grid too large.
    """
    progress = progress or Progress()
    grid = common_grid(reference, moving, parameters)
    plane = parameters.cell_value == "plane"
    progress.update(0.05, "gridding the first epoch")
    first = cell_statistics(reference, grid, plane=plane)
    progress.update(0.4, "gridding the second epoch")
    second = cell_statistics(moving, grid, plane=plane)
    progress.update(0.75, "differencing")
    change = difference_of_cells(first, second, grid, parameters, registration_error=registration_error, area=area)
    progress.update(1.0, "differencing")
    return change


def difference_of_cells(
    first: CellStatistics,
    second: CellStatistics,
    grid: Grid,
    parameters: ChangeParameters,
    *,
    registration_error: float = 0.0,
    area: BaseGeometry | None = None,
) -> Change:
    """As ``difference``, from the statistics of both epochs' cells on ``grid`` (a series keeps them)."""
    valid_first = first.count >= parameters.minimum_points
    valid_second = second.count >= parameters.minimum_points
    if area is not None:
        inside = cells_inside(area, grid)
        valid_first, valid_second = valid_first & inside, valid_second & inside
    both = valid_first & valid_second
    if not both.any():
        raise InputError(
            f"No cell of {parameters.cell:g} m has {parameters.minimum_points} or more points in both epochs; "
            "use a larger cell or fewer points a cell."
        )
    if max(first.degrees.max(), second.degrees.max()) <= 0:
        raise InputError(
            f"No cell of {parameters.cell:g} m holds two points of an epoch, so that their scatter and the level of "
            "detection cannot be told; use a larger cell."
        )
    dz = np.where(both, second.height - first.height, np.nan)
    if parameters.registration_error >= 0:
        registration_error = parameters.registration_error
    sampling = first.leverage * pooled_variance(first) + second.leverage * pooled_variance(second)
    error = np.where(both, np.sqrt(sampling + registration_error**2), np.nan)
    level = NormalDist().inv_cdf((1 + parameters.confidence) / 2) * error
    with np.errstate(invalid="ignore"):
        significant = np.abs(dz) > level
    return Change(
        grid=grid,
        dz=dz,
        error=error,
        level=level,
        significant=significant,
        count_from=first.count,
        count_to=second.count,
        height_from=first.height,
        height_to=second.height,
        confidence=parameters.confidence,
        registration_error=registration_error,
        common_cell_rate=float(both.sum() / (valid_first | valid_second).sum()),
        uniform_dz=uniform_shift(dz[both], level[both]),
        stable=both & ~ndimage.binary_dilation(significant, np.ones((3, 3), dtype=bool)),
        slope=slope_degrees(slope_gradient((first.height, second.height), grid)),
        minimum_points=parameters.minimum_points,
    )


def cells_inside(area: BaseGeometry, grid: Grid) -> NDArray[np.bool_]:
    """Cells (rows, columns) that lie wholly inside the polygons."""
    # a cell is inside if its centre is, and no edge of the polygons comes nearer than half the cell's diagonal
    core = area.buffer(-grid.cell * math.sqrt(0.5))
    if core.is_empty:
        return np.zeros(grid.shape, dtype=bool)
    affine = Affine(*grid.affine)
    inside: NDArray[np.bool_] = geometry_mask([core], grid.shape, affine, invert=True)
    return inside


def common_rate_at(change: Change, multiple: int) -> float:
    """Share of common cells, were the cells ``multiple`` times as large."""
    least = max(int(change.minimum_points), 1)
    common, either = (
        combine(*(_blocks(count, multiple) >= least for count in (change.count_from, change.count_to)))
        for combine in (np.logical_and, np.logical_or)
    )
    return float(common.sum() / max(either.sum(), 1))


def cell_that_compares(change: Change, share: float = 0.8) -> float | None:
    """The smallest multiple of the cell with which at least ``share`` of the cells would be common; None: none is."""
    for multiple in (2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 50):
        if multiple >= max(change.grid.shape):
            break
        if common_rate_at(change, multiple) >= share:
            return round(multiple * change.grid.cell, 6)
    return None


def compared_share(change: Change, block: float = 1.0) -> float:
    """Area of the common cells over the area that either epoch reached, in blocks of at least ``block`` metres."""
    multiple = max(1, math.ceil(block / change.grid.cell - 1e-9))
    reached = (_blocks(change.count_from, multiple) + _blocks(change.count_to, multiple)) > 0
    return min(1.0, float(change.valid.sum() / (reached.sum() * multiple**2)))


def _blocks(count: NDArray[np.int64], multiple: int) -> NDArray[np.int64]:
    """Points in blocks of ``multiple`` by ``multiple`` cells."""
    rows = np.arange(0, count.shape[0], multiple)
    columns = np.arange(0, count.shape[1], multiple)
    blocks: NDArray[np.int64] = np.add.reduceat(np.add.reduceat(count, rows, axis=0), columns, axis=1)
    return blocks


def pooled_variance(cells: CellStatistics, *, radius: int = 5) -> Float:
    """Variance of a point in each cell, moderated by its neighbourhood.

    The variance from two or three points is nearly worthless: small by chance, it would make noise significant. So the
    pooled variance of the cells within ``radius`` counts as a prior with ``_PRIOR_DEGREES`` degrees of freedom
    (moderated variance, Smyth 2004, doi:10.2202/1544-6115.1027, eq. 5).
    """
    size = 2 * radius + 1
    spread = np.maximum(cells.count - 1.0, 0.0)
    pooled = _moderated(cells.scatter, spread, size)
    if cells.tilted.any():
        # a plane's residuals do not hold the cell's slope, a mean's do: each kind learns from its own
        fitted = np.where(cells.tilted, cells.degrees, 0.0)
        pooled[cells.tilted] = _moderated(cells.variance, fitted, size)[cells.tilted]
    return pooled


def _moderated(own: Float, degrees: Float, size: int) -> Float:
    """Variance with ``degrees`` of freedom a cell, pulled to the pooled one of ``size`` by ``size`` cells around."""
    squares = np.nan_to_num(own) * degrees
    near = ndimage.uniform_filter(np.stack([squares, degrees]), (1, size, size), mode="constant") * size**2
    whole = squares.sum() / max(degrees.sum(), 1.0)
    enough = near[1] >= 0.5
    prior = np.where(enough, np.maximum(near[0], 0.0) / np.where(enough, near[1], 1.0), whole)
    return (squares + _PRIOR_DEGREES * prior) / (degrees + _PRIOR_DEGREES)


def uniform_shift(dz: Float, level: Float) -> float | None:
    """Median dz where the whole overlap has moved alike, else None.

    A whole surface that rises or sinks by one amount is a datum or a bias, not a deformation: nine tenths of the cells
    lie beyond their level on one side, and their spread is small beside the shift.
    """
    shift = float(np.median(dz))
    spread = 1.4826 * float(np.median(np.abs(dz - shift)))
    beyond = float(np.mean(dz * math.copysign(1.0, shift) > level))
    return shift if dz.size >= _FEWEST_CELLS and beyond >= 0.9 and spread < abs(shift) / 3 else None


def _bytes(grid: Grid) -> float:
    return grid.rows * grid.columns * _BYTES_A_CELL


def _cell_that_fits(bounds: tuple[float, float, float, float], cell: float, limit: float) -> float:
    """The smallest cell of two significant digits, in steps of a tenth, whose grid stays below ``limit`` bytes."""
    while _bytes(snapped_grid(bounds, cell)) > limit:
        larger = cell * 1.1
        unit = 10.0 ** (math.floor(math.log10(larger)) - 1)
        cell = round(math.ceil(larger / unit) * unit, 10)
    return cell


def _extent(bounds: tuple[float, ...]) -> str:
    return f"x {bounds[0]:.1f} to {bounds[2]:.1f}, y {bounds[1]:.1f} to {bounds[3]:.1f}"
