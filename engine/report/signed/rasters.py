"""The rasters of an output folder as the report to sign needs them: pictures of a part of the slope, and sections."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import geometry_mask
from shapely.geometry.base import BaseGeometry

from ....interface.seen import RASTER
from ...grid.grid import Grid
from ...grid.listed_raster import ListedRasters, read_listed
from ...maps import opacity_band
from ...maps.heatmap_image import Unseen
from ...maps.palette import BELOW_LEVEL, colour_limit, diverging_colours
from ...maps.relief import hillshade
from ...maps.unseen import read_unseen
from ...statistics.layout import Laid, layout_of
from ...zones.profiles import Layers
from ..maps import GAP, closed
from ..record_shape import inside

_EMPTY = 255
_LIGHT, _DARK = 248.0, 150.0  # of the relief under the change, 0 to 255
_MAX_WINDOW_PIXELS = 700
_MIN_CONTRAST = 30.0  # of 255: an even slope shall not show its noise
_VEIL = 0.15
"""Share of grey over what was measured and is below its level."""


@dataclass(frozen=True)
class Surface:
    """The change on its grid with the later survey's heights under it, as ``layers``; ``limit`` of the colours, metres,
    and what they mean as ``legend``.

    ``heights`` says whether they are known: a series keeps only the change. Maps hatch the cells that are ``unseen``.
    """

    layers: Layers
    limit: float
    heights: bool
    unseen: Unseen | None = None
    legend: str = "Elevation change (m)"

    @property
    def grid(self) -> Grid:
        return self.layers.grid

    def window(self, bounds: tuple[float, float, float, float]) -> tuple[slice, slice]:
        """Rows and columns of the cells within west, south, east and north, as far as the grid reaches."""
        grid = self.grid
        west, south, east, north = bounds
        rows = _span((grid.north - north) / grid.cell, (grid.north - south) / grid.cell, grid.rows)
        return rows, _span((west - grid.west) / grid.cell, (east - grid.west) / grid.cell, grid.columns)

    def picture(self, window: tuple[slice, slice]) -> tuple[NDArray[np.uint8], Grid]:
        """The change in colour over relief (rows, columns, 3), and its grid; large parts are drawn coarser."""
        rows, columns = window
        tall, wide = rows.stop - rows.start, columns.stop - columns.start
        every = max(1, math.ceil(max(tall, wide) / _MAX_WINDOW_PIXELS))
        image = self._relief(window, every)
        self._paint(image, window, every)
        west = self.grid.west + columns.start * self.grid.cell
        north = self.grid.north - rows.start * self.grid.cell
        return image, Grid(west, north, self.grid.cell * every, *image.shape[:2])

    def height_range(self, shape: BaseGeometry) -> tuple[float | None, float | None]:
        """Lowest and highest ground of the later survey within a polygon, metres; None where it is not known."""
        rows, columns = self.window(shape.bounds)
        heights = _dense(self.layers, self.layers.height_to, (rows, columns))
        corner = Affine(*self.grid.affine) * Affine.translation(columns.start, rows.start)
        own = heights[geometry_mask([shape], heights.shape, corner, invert=True) & np.isfinite(heights)]
        return (float(own.min()), float(own.max())) if own.size else (None, None)

    def _relief(self, window: tuple[slice, slice], every: int) -> NDArray[np.uint8]:
        rows, columns = window
        shape = tuple(math.ceil((span.stop - span.start) / every) for span in window)
        image = np.full((*shape, 3), _EMPTY, dtype=np.uint8)
        if not self.heights:
            return image
        whole = rows == slice(0, self.grid.rows) and columns == slice(0, self.grid.columns)
        layout = self.layers.layout
        if whole and every > 1 and layout is not None:
            heights = closed(Laid(self.layers.height_to, layout), self.grid.cell, GAP, every=every)
        else:
            heights = closed(_dense(self.layers, self.layers.height_to, window), self.grid.cell, GAP, every=every)
        shade = hillshade(heights, self.grid.cell * every)
        known = np.isfinite(shade)
        low, high = np.percentile(shade[known], (2, 98)) if known.any() else (0.0, 1.0)
        lightness = np.clip((np.nan_to_num(shade) - low) / max(high - low, _MIN_CONTRAST), 0.0, 1.0)
        grey = _DARK + (_LIGHT - _DARK) * lightness
        part = image[: heights.shape[0], : heights.shape[1]]
        part[known] = np.rint(grey[known])[:, np.newaxis].astype(np.uint8)
        return image

    def _paint(self, image: NDArray[np.uint8], window: tuple[slice, slice], every: int) -> None:
        """A veil where the change is below its level, and its colour where it is beyond; the largest on top."""
        dz, layout = self.layers.dz, self.layers.layout
        known = np.flatnonzero(np.isfinite(dz))
        row, column = layout_of(dz).row_and_column(known) if layout is None else layout.row_and_column(known)
        near = (row >= window[0].start) & (row < window[0].stop) & (column >= window[1].start)
        near &= column < window[1].stop
        known, row, column = known[near], row[near] - window[0].start, column[near] - window[1].start
        beyond = self.layers.significant.ravel()[known]
        row, column, values = row // every, column // every, dz.ravel()[known]
        below = image[row[~beyond], column[~beyond]].astype(np.float64)
        image[row[~beyond], column[~beyond]] = np.rint(below * (1 - _VEIL) + _VEIL * np.array(BELOW_LEVEL))
        order = np.argsort(np.abs(values[beyond]), kind="stable")
        row, column, values = row[beyond][order], column[beyond][order], values[beyond][order]
        image[row, column] = diverging_colours(values, self.limit)


def surface_of(record: Mapping[str, Any], folder: Path) -> Surface | None:
    """The surface of a change, of distances along the normals, or of a series' last survey against its first.

    None where its rasters are not kept.
    """
    if record.get("epochs"):
        change, level, beyond = (
            folder / f"{n}.tif" for n in ("elevation_change", "level_of_detection", "significant_change")
        )
        heights = folder / "surface_heights.tif"
        sources = [(change, 1), (level, 1), (beyond, 1), (heights, 1), (heights, 2)]
        if not all(path.is_file() for path, _ in sources):
            return None
        rasters = read_listed(sources)
        dz, height_from, height_to = rasters.values[0], rasters.values[3], rasters.values[4]
        significant = np.isfinite(rasters.values[2])
        limit = float(record["colour_limit_m"])
        layers = Layers(rasters.grid, height_from, height_to, dz, rasters.values[1], significant, rasters.layout)
        return Surface(layers, limit, heights=True, unseen=read_unseen(folder / RASTER))
    if record["command"] == "m3c2":
        names = ("m3c2_distance", "m3c2_level_of_detection", "m3c2_significant")
        paths = [folder / f"{name}.tif" for name in names]
        if not all(path.is_file() for path in paths):
            return None
        rasters = read_listed([(path, 1) for path in paths])
        surface = _without_heights(rasters, np.isfinite(rasters.values[2]), float(record["colour_limit_m"]))
        return replace(surface, legend="Distance along the normal (m)")
    return _series_surface(record, folder)


def _series_surface(record: Mapping[str, Any], folder: Path) -> Surface | None:
    number = len(record.get("dates") or []) - 1
    names = [record["outputs"].get(f"cumulative_{kind}_{number:03d}", "") for kind in ("change", "level")]
    paths = [inside(folder, name) for name in names]
    found = [path for path in paths if path is not None and path.is_file()]
    if len(found) != len(names):
        return None
    rasters = read_listed([(found[0], 1), (found[1], 1), (found[0], opacity_band.BAND)])
    dz, level, opacity = rasters.values
    significant = opacity > (opacity_band.OPAQUE + opacity_band.WITHIN) / 2
    known = level[np.isfinite(level)]
    limit = colour_limit(dz[significant], level=float(np.median(known)) if known.size else 0.1)
    seen = inside(folder, record["outputs"].get(f"cumulative_seen_{number:03d}", ""))
    return _without_heights(rasters, significant, limit, None if seen is None else read_unseen(seen))


def _without_heights(
    rasters: ListedRasters, significant: NDArray[np.bool_], limit: float, unseen: Unseen | None = None
) -> Surface:
    dz, level = rasters.values[:2]
    nothing = np.full_like(dz, np.nan)
    layers = Layers(rasters.grid, nothing, nothing, dz, level, significant, rasters.layout)
    return Surface(layers, limit, heights=False, unseen=unseen)


def _dense(layers: Layers, values: NDArray[np.floating], window: tuple[slice, slice]) -> NDArray[np.float64]:
    part = values[window] if layers.layout is None else layers.layout.window(values, window)
    return np.asarray(part, dtype=np.float64)


def _span(low: float, high: float, count: int) -> slice:
    first = min(max(math.floor(low), 0), count - 1)
    return slice(first, min(max(math.ceil(high), first + 1), count))
