"""Elevation models on one grid: the coarsest of them, by means over areas, so that no detail is invented."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from affine import Affine
from pyproj import CRS
from rasterio.enums import Resampling
from rasterio.warp import reproject, transform_bounds
from scipy import sparse

from ..core.arrays import Float
from ..core.errors import InputError
from ..core.messages import shown
from ..crs.working_frame import horizontal
from ..grid.grid import Grid, snapped_grid
from .model import MAX_CELLS, ElevationModel

MIN_KNOWN_SHARE = 0.5
"""Share of a cell's area whose height must be known."""
_ALIGNED_CELLS = 1e-4
_FINER = 1.001  # ratio of cells from which they are not one size


def on_one_grid(models: Sequence[ElevationModel], cell: float | None = None) -> tuple[list[ElevationModel], list[str]]:
    """The models on the common part of their extents, and what was done to bring them there, in sentences.

    The cell is that of the coarsest model, or larger where asked for. Models whose cells are those of the grid are cut;
    others are averaged over the area of each of its cells, and where a shift is a part of a cell that is linear
    interpolation. Models in another horizontal system are first warped to that of the first, at their own resolution.

    Args:
        cell: side of a cell, metres; not smaller than the coarsest model's.

    Raises:
        InputError: no overlap, a cell smaller than the coarsest, or too many cells.
    """
    sentences: list[str] = []
    target = horizontal(models[0].crs)
    assert target is not None
    models = [_in_system(model, target, sentences) for model in models]
    coarsest = max(model.grid.cell for model in models)
    if cell is not None and cell < coarsest / _FINER:
        name = max(models, key=lambda m: m.grid.cell).path
        raise InputError(
            f"The cell is {cell:g} m, and those of {shown(name)} are {coarsest:g} m; no detail can be invented, so "
            f"give a cell of {coarsest:g} m or more."
        )
    grid = _common_grid(models, cell or coarsest)
    for model in models:
        if model.grid.cell < grid.cell / _FINER:
            sentences.append(
                f"{shown(model.path)} has cells of {model.grid.cell:g} m; they were averaged to "
                f"those of {grid.cell:g} m."
            )
        elif not _aligned(model.grid, grid):
            sentences.append(
                f"The cells of {shown(model.path)} lie at other places than those of the common grid; their heights "
                "were weighted by area, which smooths them."
            )
    return [replace(model, heights=on_grid_by_area(model.heights, model.grid, grid), grid=grid) for model in models], (
        sentences
    )


def _in_system(model: ElevationModel, target: CRS, sentences: list[str]) -> ElevationModel:
    own = horizontal(model.crs)
    assert own is not None
    if own.equals(target, ignore_axis_order=True):
        return model
    bounds = transform_bounds(own.to_wkt(), target.to_wkt(), *model.grid.bounds, densify_pts=21)
    if not np.isfinite(bounds).all():
        raise InputError(f"{shown(model.path)} cannot be brought to {target.name}; check its reference system.")
    grid = snapped_grid(bounds, model.grid.cell)
    heights = np.full(grid.shape, np.nan)
    reproject(
        model.heights,
        heights,
        src_transform=Affine(*model.grid.affine),
        dst_transform=Affine(*grid.affine),
        src_crs=own.to_wkt(),
        dst_crs=target.to_wkt(),
        src_nodata=np.nan,
        dst_nodata=np.nan,
        resampling=Resampling.bilinear,
        num_threads=1,
    )
    sentences.append(f"{shown(model.path)} was warped from {own.name} to {target.name}.")
    return replace(model, heights=heights, grid=grid)


def _common_grid(models: Sequence[ElevationModel], cell: float) -> Grid:
    """Aligned to the first of the models that has this cell, where one has."""
    for first, second in combinations(models, 2):
        _refuse_apart(first, second)
    bounds = [model.grid.bounds for model in models]
    west, south = (max(b[i] for b in bounds) for i in (0, 1))
    east, north = (min(b[i] for b in bounds) for i in (2, 3))
    like = next((m.grid for m in models if abs(m.grid.cell / cell - 1.0) < _FINER - 1.0), None)
    origin = (0.0, 0.0) if like is None else (like.west, like.north)
    first_column = math.ceil((west - origin[0]) / cell - _ALIGNED_CELLS)
    last_column = math.floor((east - origin[0]) / cell + _ALIGNED_CELLS)
    first_row = math.ceil((origin[1] - north) / cell - _ALIGNED_CELLS)
    last_row = math.floor((origin[1] - south) / cell + _ALIGNED_CELLS)
    rows, columns = last_row - first_row, last_column - first_column
    if rows < 1 or columns < 1:
        raise InputError(
            f"The elevation models share {max(east - west, 0.0):.1f} by {max(north - south, 0.0):.1f} m, less than a "
            f"cell of {cell:g} m; give models of the same place."
        )
    if rows * columns > MAX_CELLS:
        raise InputError(f"The common grid has {rows * columns:,} cells of {cell:g} m; give a larger cell.")
    return Grid(origin[0] + first_column * cell, origin[1] - first_row * cell, cell, rows, columns)


def _refuse_apart(first: ElevationModel, second: ElevationModel) -> None:
    a, b = first.grid.bounds, second.grid.bounds
    apart = [max(a[i] - b[i + 2], b[i] - a[i + 2], 0.0) for i in (0, 1)]
    if max(apart) > 0:
        raise InputError(
            f"{shown(first.path)} and {shown(second.path)} do not overlap: they lie {math.hypot(*apart):,.0f} m apart; "
            "check their places and reference systems."
        )


def _aligned(own: Grid, grid: Grid) -> bool:
    places = (own.west - grid.west) / grid.cell, (own.north - grid.north) / grid.cell
    return all(abs(place - round(place)) < _ALIGNED_CELLS for place in places)


def on_grid_by_area(heights: Float, own: Grid, grid: Grid) -> Float:
    """Mean heights over the area of each cell of ``grid``; NaN where less than half of it is known.

    Args:
        heights: (rows, columns) of ``own``.
    """
    down = _shares(own.north, own.cell, own.rows, grid.north, grid.cell, grid.rows)
    across = _shares(-own.west, own.cell, own.columns, -grid.west, grid.cell, grid.columns)
    known = np.isfinite(heights)
    # about a height of the place: small numbers keep their digits
    about = float(np.median(heights[known])) if known.any() else 0.0
    total = down @ np.where(known, heights - about, 0.0) @ across.T
    share = down @ known.astype(np.float64) @ across.T
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(share >= MIN_KNOWN_SHARE - 1e-9, total / share + about, np.nan)


def _shares(start: float, side: float, count: int, to_start: float, to_side: float, to_count: int) -> sparse.csr_array:
    """(to_count, count): which share of each target interval each source interval takes; both count downwards."""
    own = (to_start - start) / to_side + np.arange(count + 1) * (side / to_side)
    whole = np.abs(own - np.round(own)) < _ALIGNED_CELLS
    own[whole] = np.round(own[whole])
    rows, columns, shares = [], [], []
    first = np.floor(own[:-1]).astype(np.int64)
    for step in range(math.ceil(side / to_side) + 1):
        target = first + step
        share = np.minimum(own[1:], target + 1.0) - np.maximum(own[:-1], target)
        kept = (share > 0) & (target >= 0) & (target < to_count)
        rows.append(target[kept])
        columns.append(np.flatnonzero(kept))
        shares.append(share[kept])
    place = np.concatenate(rows), np.concatenate(columns)
    return sparse.csr_array((np.concatenate(shares), place), shape=(to_count, count))
