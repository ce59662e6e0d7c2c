"""Top view: the cloud as an orthographic picture from straight above."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Bool, Float
from ..grid.grid import Grid
from ..pointcloud.cloud import PointCloud
from ..pointcloud.in_parts import CloudFile
from ..statistics.layout import bands
from .highest_points import highest, highest_points
from .relief import shaded_relief

FILL_DISTANCE = 2


@dataclass(frozen=True)
class TopView:
    """``rgba`` uint8 (rows, columns, 4), transparent where nothing was measured, on ``grid``.

    ``source`` says what the colours are: ``rgb``, ``intensity`` or ``height`` (shaded relief).
    """

    rgba: NDArray[np.uint8]
    grid: Grid
    source: str


def top_view_grid(grid: Grid, pixel: float) -> Grid:
    """The grid with the same north-west corner that covers ``grid`` with pixels of side ``pixel`` (metres)."""

    def count(cells: int) -> int:
        return max(1, int(np.ceil(cells * grid.cell / pixel - 1e-6)))

    return Grid(west=grid.west, north=grid.north, cell=pixel, rows=count(grid.rows), columns=count(grid.columns))


def top_view(cloud: PointCloud | CloudFile, grid: Grid) -> TopView:
    """The top view of a cloud in its colours, else its intensity, else its relief; see ``project``."""
    if isinstance(cloud, CloudFile):
        cloud = highest_points(cloud, grid)
    return project(cloud.xyz, grid, rgb=cloud.rgb, intensity=cloud.intensity)


def project(
    xyz: Float,
    grid: Grid,
    *,
    rgb: NDArray[np.uint8] | None = None,
    intensity: NDArray[np.integer] | None = None,
    fill_distance: int = FILL_DISTANCE,
) -> TopView:
    """Project the cloud onto ``grid``: each pixel shows its highest point (the last of equally high ones).

    Colours are ``rgb`` (n, 3) where it holds any colour, else ``intensity`` (n,) between its 2nd and 98th percentile in
    grey, else shaded relief of the heights. Pixels without a point inside gaps of at most ``2 * fill_distance``
    pixels take the mean of their neighbours, ring by ring; the picture's outline does not grow.

    Args:
        xyz: (n, 3) points in metres; those outside the grid are left out.
    """
    pixel, point, every = highest(xyz, grid)
    if rgb is not None and rgb.any():
        source, shown = "rgb", rgb[point].astype(np.float32)
    elif intensity is not None and intensity.size and intensity.min() < intensity.max():
        values = intensity[point].astype(np.float32)
        source, shown = "intensity", stretched(values, *stretch_levels(intensity[every]))[:, np.newaxis]
    else:
        source, shown = "height", xyz[point, 2:3].astype(np.float32)

    def lines(first: int, last: int) -> tuple[NDArray[np.float32], Bool]:
        here = slice(*np.searchsorted(pixel, (first * grid.columns, last * grid.columns)).tolist())
        picture = np.zeros(((last - first) * grid.columns, shown.shape[1]), dtype=np.float32)
        filled = np.zeros(len(picture), dtype=bool)
        picture[pixel[here] - first * grid.columns] = shown[here]
        filled[pixel[here] - first * grid.columns] = True
        shape = last - first, grid.columns
        return picture.reshape(*shape, shown.shape[1]), filled.reshape(shape)

    return painted(lines, grid, source, fill_distance)


def painted(
    lines: Callable[[int, int], tuple[NDArray[np.float32], Bool]], grid: Grid, source: str, fill_distance: int
) -> TopView:
    """The top view of what the pixels show, gaps filled as ``project`` says.

    Args:
        lines: colours (0 to 255) or heights (m), (rows, columns, bands), of the rows from a first one to the one before
            a last, and which pixels are known; both may be changed.
        source: as of ``TopView``; heights are shaded.
    """
    rgba = np.zeros((*grid.shape, 4), dtype=np.uint8)
    heights = np.full(grid.shape, np.nan, dtype=np.float32) if source == "height" else None
    margin = 4 * fill_distance + 1  # pixels from which a gap's colour can come
    for rows in bands(grid.shape):
        first, last = max(rows.start - margin, 0), min(rows.stop + margin, grid.rows)
        colours, filled = lines(first, last)
        known = _fill_gaps(colours, filled, fill_distance)
        own = slice(rows.start - first, rows.stop - first)
        if heights is not None:
            heights[rows] = np.where(known[own], colours[own, :, 0], np.nan)
        else:
            rgba[rows, :, :3] = np.clip(np.rint(colours[own]), 0, 255)
        rgba[rows, :, 3] = np.where(known[own], 255, 0)
    if heights is not None:
        rgba[..., :3] = np.clip(np.rint(shaded_relief(heights, grid.cell)), 0, 255)
    rgba[rgba[..., 3] == 0] = 0
    return TopView(rgba=rgba, grid=grid, source=source)


def stretch_levels(values: NDArray[np.integer]) -> tuple[float, float]:
    """What becomes black and what white: the 2nd and the 98th percentile of intensities (n,)."""
    low, high = np.percentile(values.astype(np.float32), (2, 98)) if values.size else (0.0, 1.0)
    return low, high


def stretched(values: NDArray[np.float32], low: float, high: float) -> NDArray[np.float32]:
    """Values of any shape from ``low`` to ``high`` as 0 to 255."""
    return (np.clip((values - low) / max(high - low, 1e-6), 0.0, 1.0) * 255.0).astype(np.float32)


def _fill_gaps(picture: NDArray[np.float32], filled: Bool, distance: int) -> Bool:
    """Fill ``picture`` (rows, columns, bands) in place; returns which pixels are known now."""
    width = 2 * distance + 1
    closed = ndimage.minimum_filter(ndimage.maximum_filter(np.pad(filled, distance), width), width)
    wanted = closed[distance:, distance:][: filled.shape[0], : filled.shape[1]] & ~filled
    known = np.pad(filled, 1)
    values = np.pad(picture, ((1, 1), (1, 1), (0, 0)))
    for _ in range(2 * distance):
        row, column = np.nonzero(wanted)
        total = np.zeros((len(row), picture.shape[2]), dtype=np.float32)
        count = np.zeros(len(row), dtype=np.float32)
        for i in range(3):
            for j in range(3):
                near = known[row + i, column + j]
                count += near
                total += values[row + i, column + j] * near[:, np.newaxis]
        ready = count > 0
        if not ready.any():
            break
        row, column = row[ready], column[ready]
        values[row + 1, column + 1] = total[ready] / count[ready, np.newaxis]
        known[row + 1, column + 1] = True
        wanted[row, column] = False
    picture[...] = values[1:-1, 1:-1]
    return known[1:-1, 1:-1]
