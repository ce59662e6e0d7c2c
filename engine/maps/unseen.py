"""Hatching over what was not seen, so that a map does not let it look like ground that did not move."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...interface.seen import NOT_SEEN
from ..grid.geotiff import grid_of, open_any_grid
from .heatmap_image import Unseen
from .map_parts import Sheet
from .palette import UNSEEN_FILL, UNSEEN_STRIPE
from .picture_words import say

_PIXELS = 1400  # along the longer side of what is hatched
_PERIOD_IN, _STRIPE_SHARE = 0.075, 0.3  # from stripe to stripe along a row, and how much of that is stripe
_KEY_PIXELS_AN_INCH = 400
WORDS = "not seen: nothing is known"


def read_unseen(path: Path) -> Unseen | None:
    """From ``seen.tif``; None if there is no such file, or all was seen.

    Raises:
        InputError: the file is no raster of one run.
    """
    if not path.is_file():
        return None
    with open_any_grid(path) as source:
        unseen = Unseen(np.isin(source.read(1), NOT_SEEN), grid_of(source, path))
    return unseen if unseen.cells.any() else None


def draw_unseen(axes: Axes, unseen: Unseen, inches_a_metre: float) -> bool:
    """Hatch the cells that lie within the limits of ``axes``; whether there are any."""
    grid, (west, east), (south, north) = unseen.grid, axes.get_xlim(), axes.get_ylim()
    first = max(math.floor((grid.north - north) / grid.cell), 0), max(math.floor((west - grid.west) / grid.cell), 0)
    last = math.ceil((grid.north - south) / grid.cell), math.ceil((east - grid.west) / grid.cell)
    part = unseen.cells[first[0] : max(last[0], 0), first[1] : max(last[1], 0)]
    if not part.any():
        return False
    every = math.ceil(max(part.shape) / _PIXELS)
    times = max(1, _PIXELS // max(part.shape))
    left, top = grid.west + first[1] * grid.cell, grid.north - first[0] * grid.cell
    shown = part[::every, ::every].repeat(times, axis=0).repeat(times, axis=1)
    pixel = grid.cell * every / times
    period = max(4, round(_PERIOD_IN / inches_a_metre / pixel))
    rgba = _hatched(shown.shape, period)
    rgba[~shown] = 0
    extent = left, left + shown.shape[1] * pixel, top - shown.shape[0] * pixel, top
    limits = (west, east), (south, north)
    axes.imshow(rgba, extent=extent, interpolation="nearest", aspect="auto", zorder=1.5)
    axes.set(xlim=limits[0], ylim=limits[1])
    return True


def draw_unseen_key(sheet: Sheet, x: float, y: float, width: float = 0.24, *, backdrop: float = 255.0) -> None:
    """The legend's entry: a box of ``width`` inches, whose middle is at ``y``, hatched as the map, and what it means.

    ``backdrop`` is the lightness of what is under the hatching, 0 to 255.
    """
    axes = sheet.axes(x, y - 0.07, width, 0.14, "not seen")
    axes.set(xticks=[], yticks=[], facecolor=f"{backdrop / 255.0:.4f}")
    axes.spines[:].set(color=[band / 255.0 for band in UNSEEN_STRIPE], linewidth=0.6)
    shape = round(0.14 * _KEY_PIXELS_AN_INCH), round(width * _KEY_PIXELS_AN_INCH)
    axes.imshow(_hatched(shape, round(_PERIOD_IN * _KEY_PIXELS_AN_INCH)), interpolation="antialiased", aspect="auto")
    sheet.text(x + width + 0.06, y, say(WORDS))


def _hatched(shape: tuple[int, ...], period: int) -> NDArray[np.uint8]:
    """Stripes (rows, columns, 4) that come again every ``period`` pixels along a row."""
    stripe = np.arange(sum(shape)) % period < max(1, round(_STRIPE_SHARE * period))
    along = np.where(stripe[:, np.newaxis], UNSEEN_STRIPE, UNSEEN_FILL).astype(np.uint8)
    return sliding_window_view(along, shape[1], axis=0)[: shape[0]].transpose(0, 2, 1).copy()
