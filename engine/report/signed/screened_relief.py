"""The ground of a survey that was screened as a map shows it: relief of its points, and where they are labelled."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from ....interface.input_files import CLOUD
from ...core.arrays import Float
from ...core.errors import InputError
from ...core.input_files import open_input
from ...grid.grid import Grid
from ...maps.relief import hillshade
from ..maps import GAP, closed
from .screened_ground import LABELS, MAX_POINTS

RAISED, LOWERED = "#2166ac", "#b2182b"
_CHUNK = 1_000_000
_MOST_PIXELS = 900
_FILLED_SHARE = 0.8  # of the pixels of an even cloud that shall hold a point
_DARK, _LIGHT, _LEAST_CONTRAST = 120.0, 240.0, 30.0  # of the relief, 0 to 255
_OPACITY = 0.65
_GAP_CELLS = 2.5  # that are closed in sparse clouds


@dataclass(frozen=True)
class ScreenedRelief:
    """``image`` (rows, columns, 3), 0 to 255, white where no point is, on its ``grid``."""

    image: NDArray[np.uint8]
    grid: Grid
    limit: None = None
    legend: str = ""
    """It has no scale of colours."""
    unseen: None = None
    """Nothing of it was compared."""

    def window(self, bounds: tuple[float, float, float, float]) -> tuple[slice, slice]:
        """All of it, however much of it the map shows."""
        return slice(0, self.grid.rows), slice(0, self.grid.columns)

    def picture(self, window: tuple[slice, slice]) -> tuple[NDArray[np.uint8], Grid]:
        return self.image[window], self.grid


def screened_relief(path: Path) -> ScreenedRelief | None:
    """The relief of a labelled cloud; None where it cannot be read, has no labels or is too large for a report."""
    try:
        with open_input(path, CLOUD) as stream, laspy.open(stream) as source:
            header = source.header
            if not 0 < header.point_count <= MAX_POINTS or LABELS not in header.point_format.dimension_names:
                return None
            grid = _grid(header.mins, header.maxs, header.point_count)
            sums = np.zeros((4, grid.rows * grid.columns))
            for chunk in source.chunk_iterator(_CHUNK):
                _add(sums, grid, np.column_stack([chunk.x, chunk.y, chunk.z]), np.asarray(chunk[LABELS]))
    except (InputError, OSError, ValueError, laspy.errors.LaspyException):
        return None
    return ScreenedRelief(_image(sums, grid), grid)


def _grid(low: Float, high: Float, count: int) -> Grid:
    """Cells that hold a point each where the points lie evenly, and no more than a map can show."""
    wide, tall = (max(float(side), 1e-3) for side in (high - low)[:2])
    spacing = math.sqrt(wide * tall / count)
    cell = max(spacing * math.sqrt(-math.log(1.0 - _FILLED_SHARE)), max(wide, tall) / _MOST_PIXELS)
    return Grid(float(low[0]), float(high[1]), cell, max(1, math.ceil(tall / cell)), max(1, math.ceil(wide / cell)))


def _add(sums: Float, grid: Grid, points: Float, labels: NDArray[np.uint8]) -> None:
    """Add points to the sums of their cells: how many, their heights, how many are raised and lowered."""
    column = np.clip(((points[:, 0] - grid.west) / grid.cell).astype(np.int64), 0, grid.columns - 1)
    row = np.clip(((grid.north - points[:, 1]) / grid.cell).astype(np.int64), 0, grid.rows - 1)
    index, cells = row * grid.columns + column, grid.rows * grid.columns
    sums[0] += np.bincount(index, minlength=cells)
    sums[1] += np.bincount(index, weights=points[:, 2], minlength=cells)
    for number, label in ((2, 1), (3, 2)):
        sums[number] += np.bincount(index[labels == label], minlength=cells)


def _image(sums: Float, grid: Grid) -> NDArray[np.uint8]:
    count, total, raised, lowered = (part.reshape(grid.rows, grid.columns) for part in sums)
    heights = np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
    shade = hillshade(closed(heights, grid.cell, max(GAP, _GAP_CELLS * grid.cell)), grid.cell)
    image = np.full((*shade.shape, 3), 255.0)
    known = np.isfinite(shade)
    low, high = np.percentile(shade[known], (2, 98)) if known.any() else (0.0, 1.0)
    lightness = np.clip((shade[known] - low) / max(float(high - low), _LEAST_CONTRAST), 0.0, 1.0)
    image[known] = (_DARK + (_LIGHT - _DARK) * lightness)[:, np.newaxis]
    for labelled, colour in ((raised, RAISED), (lowered, LOWERED)):
        # half of a cell's points or more
        chosen = known & (2.0 * labelled >= np.maximum(count, 1.0))
        rgb = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)], dtype=np.float64)
        image[chosen] += _OPACITY * (rgb - image[chosen])
    return np.rint(image).astype(np.uint8)
