"""Maps of the report, from the rasters of an output folder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...interface.parameters import HeatmapParameters
from ...interface.seen import RASTER
from ..core.arrays import Float
from ..grid.grid import Grid
from ..grid.listed_raster import ListedRasters, read_listed
from ..maps.figure import make_figure
from ..maps.heatmap_image import Words, make_heatmap
from ..maps.map_parts import INK, Sheet, draw_colour_bar, draw_image, draw_key, draw_scale_bar
from ..maps.palette import SEQUENTIAL, Colour, colours_at, hexadecimal, sequential_steps
from ..maps.picture_words import say
from ..maps.relief import shaded_relief
from ..maps.top_view import TopView, top_view_grid
from ..maps.unseen import read_unseen
from ..statistics.layout import Laid, bands, laid
from ..vector.geopackage import read_layer
from .embedding import Picture, map_picture
from .facts import block_cells, points_a_square_metre

GAP = 1.0  # metres within which the surface of a hillshade is closed
_MAP_PIXELS, _PANEL_PIXELS = 1400, 900  # longest sides of what is drawn
_PANEL_INCHES = 4.9  # inches
_SIGMAS_CELLS, _TRUNCATE = (1.0, 2.0, 4.0, 8.0), 3.0  # of the Gauss curves that close gaps
_CELLS_AT_ONCE = 2_000_000  # of a surface whose gaps are closed
_MAX_POINTS = 100_000_000  # in a cell: a damaged file may state any number


def change_map(folder: Path, limit: float, epochs: tuple[str, str]) -> Picture:
    """Signed change where it is beyond its level, grey where it is below, with zones, scale, north and coordinates."""
    names = ("elevation_change", "level_of_detection", "significant_change")
    words = Words(
        title="Change above the level of detection", veil=("grey: measured, but", "below the level of detection")
    )
    text = (
        "Map of the elevation change beyond its level of detection: red is lowered, blue is raised, grey is below the "
        "level, hatched was not seen; the zones are outlined and numbered"
    )
    return _signed_map(folder, names, "zones.gpkg", words, text, limit, epochs)


def distance_map(folder: Path, limit: float, epochs: tuple[str, str]) -> Picture:
    """As ``change_map``, of M3C2 distances seen from above."""
    names = ("m3c2_distance", "m3c2_level_of_detection", "m3c2_significant")
    words = Words(
        title="Distance above the level of detection, seen from above",
        legend="Distance along the normal (m)",
        veil=("grey: measured, but", "below the level of detection"),
    )
    text = (
        "Map of the distances along the normal beyond their level of detection: red is lowered, blue is raised, grey "
        "is below the level; the zones are outlined and numbered"
    )
    return _signed_map(folder, names, "m3c2_zones.gpkg", words, text, limit, epochs)


def _signed_map(
    folder: Path,
    names: tuple[str, str, str],
    layer: str,
    words: Words,
    text: str,
    limit: float,
    epochs: tuple[str, str],
) -> Picture:
    """Of the rasters of change, level and significant change, and the file of the zones."""
    rasters = read_listed([(folder / f"{name}.tif", 1) for name in names])
    _, level, beyond = rasters.values
    longest = max(rasters.grid.shape) * rasters.grid.cell
    grid = top_view_grid(rasters.grid, max(rasters.grid.cell, longest / _MAP_PIXELS))
    white = np.full((*grid.shape, 4), 255, dtype=np.uint8)
    white[..., 3] = 0
    drawn = make_heatmap(
        rasters.laid(),
        np.isfinite(beyond),
        level,
        rasters.grid,
        TopView(white, grid, "none"),
        HeatmapParameters(opacity=1.0),
        limit=limit,
    )
    unseen = read_unseen(folder / RASTER) if names[0] == "elevation_change" else None
    drawn = replace(drawn, words=words, unseen=unseen)
    zones = read_layer(folder / layer, "zones") if (folder / layer).is_file() else None
    return map_picture(make_figure(drawn, zones=zones, epochs=epochs), text)


def hillshades(folder: Path) -> tuple[Picture | None, Picture | None]:
    """The surface of each epoch in shaded relief; None for an epoch without heights."""
    path = folder / "surface_heights.tif"
    if not path.is_file():
        return None, None
    both = [read_listed([(path, band)]) for band in (1, 2)]
    reliefs = [_relief(raster) for raster in both]
    # one stretch for both: a slope that faces away from the light is dark all over
    lightness = np.concatenate([relief[np.isfinite(relief)] for relief in reliefs])
    low, high = np.percentile(lightness, (1, 99)) if lightness.size else (0.0, 1.0)
    pictures: list[Picture | None] = []
    for raster, relief, epoch in zip(both, reliefs, ("earlier", "later"), strict=True):
        known = np.asarray(np.isfinite(relief[..., 0]))
        grey = 40.0 + 205.0 * (np.nan_to_num(relief) - low) / max(high - low, 1.0)
        image = np.where(known[..., np.newaxis], np.clip(np.rint(grey), 0, 255), 255).astype(np.uint8)
        words = f"Shaded relief of the {epoch} survey’s ground"
        pictures.append(panel(image, raster.grid, words) if known.any() else None)
    return pictures[0], pictures[1]


def ground_picture(path: Path, *, paler: float) -> tuple[NDArray[np.uint8], Grid] | None:
    """The later of two surfaces in shaded relief, to draw on; None where it is known nowhere.

    Args:
        path: raster of both surfaces' heights.
        paler: share of white in the picture.
    """
    raster = read_listed([(path, 2)])
    relief = _relief(raster)
    known = np.isfinite(relief[..., 0])
    if not known.any():
        return None
    low, high = np.percentile(relief[known], (1, 99))
    grey = np.clip((np.nan_to_num(relief) - low) / max(high - low, 1.0), 0.0, 1.0)
    image = np.where(known[..., np.newaxis], 255.0 * (paler + (1 - paler) * grey), 255.0)
    return np.rint(image).astype(np.uint8), raster.grid


def densities(folder: Path) -> tuple[Picture | None, Picture | None]:
    """Ground points a square metre of each epoch, on one scale."""
    path = folder / "point_counts.tif"
    if not path.is_file():
        return None, None
    counts = read_listed([(path, band) for band in (1, 2)])
    whole = [np.clip(np.nan_to_num(values), 0, _MAX_POINTS).astype(np.int64) for values in counts.values]
    blocks = [points_a_square_metre(Laid(number, counts.layout), counts.grid) for number in whole]
    reached = np.concatenate([b[b > 0] for b in blocks])
    limit = float(np.percentile(reached, 98)) if reached.size else 1.0
    first, second = (
        _density_panel(b, counts.grid, limit, words) for b, words in zip(blocks, ("earlier", "later"), strict=True)
    )
    return first, second


def cell_sizes(folder: Path) -> Picture | None:
    """Side of the cell that each place was compared in, where cells grew; of a large grid every so many-th cell."""
    path = folder / "cell_size.tif"
    if not path.is_file():
        return None
    raster = read_listed([(path, 1)])
    (held,) = raster.values
    sizes = np.unique(held)
    if not sizes.size:
        return None
    colours = sequential_steps(len(sizes))
    row, column = raster.layout.row_and_column(np.arange(held.size))
    # of each square of this many cells the middle one; matplotlib takes eighty bytes for each that it gets
    every = max(1, math.ceil(max(raster.grid.shape) / _PANEL_PIXELS))
    drawn = (row % every == every // 2) & (column % every == every // 2)
    shape = tuple(-(-n // every) for n in raster.grid.shape)
    image = np.full((*shape, 3), 255, dtype=np.uint8)
    image[row[drawn] // every, column[drawn] // every] = np.array(colours)[np.searchsorted(sizes, held[drawn])]
    words = [(f"{float(size):.4g} m", colour) for size, colour in zip(sizes, colours, strict=True)]
    grid = Grid(raster.grid.west, raster.grid.north, raster.grid.cell * every, *image.shape[:2])
    return panel(image, grid, "Map of the size of the cells that were compared", boxes=words)


def _relief(raster: ListedRasters) -> Float:
    """Shaded relief (rows, columns, 3), 0 to 255, NaN where the surface is unknown."""
    factor = max(1, math.ceil(max(raster.grid.shape) / _PANEL_PIXELS))
    if not raster.values[0].size:
        return np.full((*raster.grid.shape, 3), np.nan)
    heights = closed(raster.laid(), raster.grid.cell, GAP, every=factor)
    relief = shaded_relief(heights, raster.grid.cell * factor).astype(np.float64)
    relief[~np.isfinite(heights)] = np.nan
    return relief


def closed(heights: NDArray[np.floating] | Laid, cell: float, gap: float, *, every: int = 1) -> Float:
    """Heights with gaps up to ``gap`` metres wide filled, for a picture.

    Cells take the mean of the known ones around, weighted by a Gauss curve, of what is left over a plane: without that,
    the mean on a slope leans to the side where more is known. Large arrays are worked on in bands.

    Args:
        every: of the result, from the middle of the first so many rows and columns on, every so many-th is given.
    """
    values, layout = laid(heights).values, laid(heights).layout
    finite = np.flatnonzero(np.isfinite(values))
    row, column = layout.row_and_column(finite)
    known = values.ravel()[finite].astype(np.float64)
    design = np.column_stack([column * cell, row * cell, np.ones(known.size)])
    plane: Float = np.linalg.lstsq(design, known, rcond=None)[0].astype(np.float64)
    reach = math.ceil(max(gap / cell, _SIGMAS_CELLS[-1] * _TRUNCATE)) + 1
    wanted = range(every // 2, layout.shape[0], every), range(every // 2, layout.shape[1], every)
    filled = np.full((len(wanted[0]), len(wanted[1])), np.nan)
    for rows in bands(layout.shape, _CELLS_AT_ONCE):
        first, last = max(rows.start - reach, 0), min(rows.stop + reach, layout.shape[0])
        near = column[slice(*np.searchsorted(row, (first, last)).tolist())]
        if not near.size:
            continue
        left, right = max(int(near.min()) - reach, 0), min(int(near.max()) + reach + 1, layout.shape[1])
        window = layout.window(values, (slice(first, last), slice(left, right)))
        part = _closed(window.astype(np.float64), (first, left), plane, cell, gap)
        lines = [i for i, line in enumerate(wanted[0]) if rows.start <= line < rows.stop]
        places = [j for j, place in enumerate(wanted[1]) if left <= place < right]
        picked = np.ix_([wanted[0][i] - first for i in lines], [wanted[1][j] - left for j in places])
        filled[np.ix_(lines, places)] = part[picked]
    return filled


def _closed(heights: Float, corner: tuple[int, int], plane: Float, cell: float, gap: float) -> Float:
    """As ``closed``, of a part that begins at ``corner`` (row, column), by the plane through all."""
    rows, columns = heights.shape
    y, x = (np.arange(rows)[:, None] + corner[0]) * cell, (np.arange(columns) + corner[1]) * cell
    known = np.isfinite(heights)
    trend = plane[0] * x + plane[1] * y + plane[2]
    rest = np.where(known, heights - trend, 0.0)
    near = ndimage.distance_transform_edt(~known) * cell <= gap / 2
    # where all is near something known, there is no outside to be near to
    outside = np.zeros(near.shape, dtype=bool)
    if not near.all():
        outside = ndimage.distance_transform_edt(near) * cell <= gap / 2
    wanted = near & (~outside | known)
    filled = np.where(known, heights, np.nan)
    # from fine to coarse: a small gap shall not be smoothed as a large one
    for sigma in _SIGMAS_CELLS:
        missing = wanted & ~np.isfinite(filled)
        if not missing.any():
            break
        weight = ndimage.gaussian_filter(known.astype(np.float64), sigma, truncate=_TRUNCATE)
        total = ndimage.gaussian_filter(rest, sigma, truncate=_TRUNCATE)
        ready = missing & (weight > 0.02)
        filled[ready] = (trend + total / np.maximum(weight, 1e-9))[ready]
    return np.asarray(filled)


def _density_panel(blocks: Float, grid: Grid, limit: float, epoch: str) -> Picture:
    side = block_cells(grid)
    image = colours_at(SEQUENTIAL, blocks / limit)
    image[blocks == 0] = 255
    return panel(
        image,
        Grid(grid.west, grid.north, grid.cell * side, *blocks.shape),
        f"Map of the density of ground points of the {epoch} survey",
        legend=limit,
    )


def panel(
    image: NDArray[np.uint8],
    grid: Grid,
    text: str,
    *,
    legend: float | None = None,
    boxes: Sequence[tuple[str, Colour]] = (),
) -> Picture:
    """A small map: the picture over the grid, and a scale bar below.

    Args:
        legend: end of a scale of colours from 0, points/m².
        boxes: words and colours of a legend; in a row of their own above a scale of colours.
    """
    west, south, east, north = grid.bounds
    height = min(max(_PANEL_INCHES * (north - south) / (east - west), 0.6), 6.5)
    inches = min(_PANEL_INCHES / (east - west), height / (north - south))
    wide, tall = inches * (east - west), inches * (north - south)
    both = legend is not None and len(boxes) > 0
    foot = 0.83 if both else 0.55
    sheet = Sheet(_PANEL_INCHES, tall + foot)
    axes = sheet.axes((_PANEL_INCHES - wide) / 2, foot, wide, tall)
    draw_image(axes, image, grid, "nearest" if legend or boxes else "antialiased")
    axes.set_axis_off()
    draw_scale_bar(sheet, 0.15, 0.3, 1.6, inches)
    left = 2.5 if both else 2.0
    for number, (word, colour) in enumerate(boxes):
        x = left + number * min(0.7, (_PANEL_INCHES - left) / len(boxes))
        draw_key(sheet, x, 0.59 if both else 0.31, [say(word)], face=hexadecimal(colour), edge=INK, width=0.14)
    if legend is not None:
        ramp = colours_at(SEQUENTIAL, np.linspace(0, 1, 128))
        ticks = (0.0, 0.5 * legend, legend)
        draw_colour_bar(sheet, (2.5, 0.3, 1.6, 0.12), ramp, ticks, [f"{tick:.3g}" for tick in ticks])
        sheet.text(4.18, 0.36, say("points/m²"))
    return map_picture(sheet.figure, text)
