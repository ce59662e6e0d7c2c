"""The ground under a flight: heights on one grid without gaps, where plants reach, and how it is inclined."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pyproj import CRS
from scipy import ndimage

from ..core.arrays import Bool, Float
from ..core.errors import InputError
from ..core.messages import shown
from ..elevation_models.model import ElevationModel
from ..grid.grid import Grid, cell_index, snapped_grid

CELL_M = 1.0
"""Cell of the terrain that is made of a cloud; an elevation model of smaller cells is averaged to about this."""
MAX_CELLS = 30_000_000


@dataclass(frozen=True)
class Terrain:
    """Ground on ``grid``, metres.

    ``heights`` (rows, columns) are known or bridged, NaN beyond; ``known`` says where they were measured. ``tops`` are
    the highest places known, of ground or plants. ``path`` is the file, for messages.
    """

    heights: Float
    known: Bool
    tops: Float
    grid: Grid
    crs: CRS
    path: Path

    def at(self, xy: Float) -> Float:
        """Heights (n,) of the ground at places (n, 2), bilinear; NaN where it is not known."""
        row = (self.grid.north - xy[:, 1]) / self.grid.cell - 0.5
        column = (xy[:, 0] - self.grid.west) / self.grid.cell - 0.5
        found = ndimage.map_coordinates(self.heights, [row, column], order=1, mode="constant", cval=np.nan)
        # in the outer half of the outermost cells, and next to a gap, the cell's own height
        r, c = np.rint(row).astype(np.int64), np.rint(column).astype(np.int64)
        inside = (r >= 0) & (r < self.grid.rows) & (c >= 0) & (c < self.grid.columns)
        near = np.full(len(xy), np.nan)
        near[inside] = self.heights[r[inside], c[inside]]
        return np.where(np.isfinite(found), found, near)

    def gradient(self) -> tuple[Float, Float]:
        """Rise towards east and towards north (rows, columns)."""
        south, east = np.gradient(self.heights, self.grid.cell)
        return np.asarray(east), -np.asarray(south)

    def with_tops(self, xyz: Float) -> Terrain:
        """With the highest of these points (n, 3) where they are higher than what was known."""
        tops, place = self.tops.ravel().copy(), cell_index(xyz, self.grid)
        inside = place >= 0
        np.fmax.at(tops, place[inside], xyz[inside, 2])
        return replace(self, tops=tops.reshape(self.grid.shape))


def terrain_of_model(model: ElevationModel, bridged: float) -> Terrain:
    """The terrain of an elevation model, whose gaps are bridged up to ``bridged`` m from what is known."""
    factor = max(1, math.floor(CELL_M / model.grid.cell + 1e-9))
    grid, heights = model.grid, model.heights
    if factor > 1:
        rows, columns = (math.ceil(n / factor) for n in grid.shape)
        padded = np.full((rows * factor, columns * factor), np.nan)
        padded[: grid.rows, : grid.columns] = heights
        blocks = padded.reshape(rows, factor, columns, factor)
        known = np.isfinite(blocks)
        count = known.sum(axis=(1, 3))
        total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
        heights = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        grid = Grid(grid.west, grid.north, grid.cell * factor, rows, columns)
    return _bridged(heights, grid, model.crs, model.path, bridged)


def terrain_of_points(xyz: Float, crs: CRS, path: Path, bridged: float) -> Terrain:
    """The terrain of ground points (n, 3): means of cells of ``CELL_M``."""
    if not len(xyz):
        raise InputError(f"{shown(path)} holds no ground point; give ground that `slopewatch ground` wrote.")
    low, high = xyz[:, :2].min(axis=0), xyz[:, :2].max(axis=0)
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    grid = snapped_grid(bounds, CELL_M)
    if grid.rows * grid.columns > MAX_CELLS:
        raise InputError(f"{shown(path)} spans {grid.rows} by {grid.columns} m, too much for one plan; clip it.")
    place = cell_index(xyz, grid)
    count = np.bincount(place, minlength=grid.rows * grid.columns)
    total = np.bincount(place, xyz[:, 2], grid.rows * grid.columns)
    heights = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(grid.shape)
    return _bridged(heights, grid, crs, path, bridged)


def _bridged(heights: Float, grid: Grid, crs: CRS, path: Path, reach: float) -> Terrain:
    """Gaps and a rim up to ``reach`` m from what is known are filled.

    A gap between known ground gets the mean of the nearest ground, weighted by the inverse square of its distance in
    the grid's four directions; where only one side is known, as beyond an edge, the nearest height holds.
    """
    rim = math.ceil(reach / grid.cell)
    wide = Grid(
        grid.west - rim * grid.cell,
        grid.north + rim * grid.cell,
        grid.cell,
        grid.rows + 2 * rim,
        grid.columns + 2 * rim,
    )
    padded = np.pad(heights, rim, constant_values=np.nan)
    known = np.isfinite(padded)
    distance, nearest = ndimage.distance_transform_edt(~known, return_indices=True)
    filled = padded[tuple(nearest)]
    total, weight = np.zeros(padded.shape), np.zeros(padded.shape)
    for axis in (0, 1):
        for forward in (True, False):
            height, steps = _from_one_side(padded, known, axis, forward)
            near = np.isfinite(height) & (steps * grid.cell <= 2 * reach)
            share = np.where(near, 1.0 / np.maximum(steps, 1) ** 2, 0.0)
            total += share * np.where(near, height, 0.0)
            weight += share
    filled = np.where(weight > 0, total / np.maximum(weight, 1e-12), filled)
    filled = np.where(known, padded, np.where(distance * grid.cell <= reach, filled, np.nan))
    return Terrain(filled, known, filled.copy(), wide, crs, path)


def _from_one_side(heights: Float, known: Bool, axis: int, forward: bool) -> tuple[Float, Float]:
    """The last known height on the way to each cell along an axis, and how many cells ago it was."""
    values, mask = np.moveaxis(heights, axis, 0), np.moveaxis(known, axis, 0)
    if not forward:
        values, mask = values[::-1], mask[::-1]
    index = np.where(mask, np.arange(len(mask))[:, None], -1)
    last = np.maximum.accumulate(index, axis=0)
    height = np.take_along_axis(values, np.maximum(last, 0), axis=0)
    height = np.where(last >= 0, height, np.nan)
    steps = np.where(last >= 0, np.arange(len(mask))[:, None] - last, 0).astype(float)
    if not forward:
        height, steps = height[::-1], steps[::-1]
    return np.moveaxis(height, 0, axis), np.moveaxis(steps, 0, axis)
