"""The heatmap as an image: change laid over the top view; and the words on its map."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...interface.parameters import HeatmapParameters, given
from ..core.arrays import Bool
from ..grid.grid import Grid
from ..statistics.layout import Laid, laid
from .palette import colour_limit, diverging_colours, veiled
from .top_view import TopView

# Cells below the level lose this share of their colour, so that the coloured ones stand out.
_FADE = 0.6
_AT_ONCE = 1_000_000  # pixels that are coloured at a time
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # ITU-R BT.709


@dataclass(frozen=True)
class Unseen:
    """Cells (rows, columns) of a slope that were not compared, on their grid."""

    cells: Bool
    grid: Grid


@dataclass(frozen=True)
class Words:
    """What a map says of itself; an elevation change by default.

    ``low`` and ``high`` name the legend's ends, ``veil`` and ``outline`` the keys; ``notes`` stand below the title,
    those of a change where they are empty. ``signed``: whether the legend's numbers have a sign. ``upwards`` is what
    the arrow along the picture's upper side says.
    """

    title: str = "Elevation change"
    legend: str = "Elevation change (m)"
    low: str = "lowered"
    high: str = "raised"
    veil: tuple[str, str] = ("grey veil: measured, but", "below the level of detection")
    outline: str = "hazard zone"
    notes: str = ""
    signed: bool = True
    upwards: str = "N"


@dataclass(frozen=True)
class Heatmap:
    """``rgba`` uint8 (rows, columns, 4) on ``grid``; the colours run from ``-limit`` to ``+limit`` metres.

    ``level`` is the median level of detection in metres, NaN if there is none; ``opacity`` that of the change and
    ``backdrop`` the mean lightness (0 to 255) of what it lies on, for a legend in the map's own colours. ``words`` are
    what the map says. A map hatches the cells that are ``unseen``.
    """

    rgba: NDArray[np.uint8]
    grid: Grid
    limit: float
    level: float
    opacity: float
    backdrop: float
    significant_cells: int
    unseen: Unseen | None = None
    words: Words = field(default_factory=Words)


def make_heatmap(
    dz: NDArray[np.floating] | Laid,
    significant: NDArray[np.bool_],
    lod: NDArray[np.floating],
    grid: Grid,
    view: TopView,
    parameters: HeatmapParameters | None = None,
    *,
    limit: float | None = None,
) -> Heatmap:
    """Lay significant change in colour, other measured cells in a grey veil, over the top view.

    Under the colours the top view is grey, so that green shrubs do not turn the hue, which distinguishes lowering from
    raising. Cells without a common measurement show the top view alone; where that is empty too, the picture is
    transparent.

    Args:
        dz, lod: change and level of detection on ``grid``, metres; NaN for no data. All three are (rows, columns), or
            lists of the same cells where the change is one.
        view: the top view, on a grid of its own.
        limit: end of the legend, metres; from the data and ``parameters`` if not given.
    """
    dz, layout = laid(dz).values, laid(dz).layout
    parameters = parameters or HeatmapParameters()
    level = float(np.median(lod[np.isfinite(lod)])) if np.isfinite(lod).any() else float("nan")
    shown = significant & np.isfinite(dz)
    if limit is None:
        limit = colour_limit(dz[shown], given(parameters.colour_range), level=level)
    row, column = _nearest_cells(view.grid, grid)
    inside = ((row >= 0) & (row < grid.rows))[:, np.newaxis] & ((column >= 0) & (column < grid.columns))
    row, column = np.clip(row, 0, grid.rows - 1), np.clip(column, 0, grid.columns - 1)
    rgba = np.zeros((*view.grid.shape, 4), dtype=np.uint8)
    greys = []
    lines = max(1, _AT_ONCE // max(view.grid.columns, 1))
    for top in range(0, view.grid.rows, lines):
        part = slice(top, top + lines)
        first, last = int(row[part].min()), int(row[part].max())
        window = np.ix_(row[part] - first, column)
        change, coloured = (layout.lines(values, slice(first, last + 1))[window] for values in (dz, shown))
        found = np.where(inside[part], change, np.nan)
        rgba[part], grey = _laid_over(view.rgba[part], found, coloured, limit, parameters.opacity)
        greys.append(grey)
    grey = np.concatenate(greys)
    backdrop = float(grey.mean()) if grey.size else 255.0
    return Heatmap(rgba, view.grid, limit, level, parameters.opacity, backdrop, int(shown.sum()))


def _laid_over(
    view: NDArray[np.uint8], dz: NDArray[np.floating], shown: NDArray[np.bool_], limit: float, opacity: float
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Some lines of the heatmap (rows, columns, 4), and the greys (n,) under its measured pixels, white without a view.

    Args:
        dz: change below each pixel, NaN without; ``shown`` where it is significant.
    """
    measured = np.isfinite(dz)
    coloured = shown & measured
    below = measured & ~coloured
    seen = view[..., 3] > 0
    base = view[..., :3].astype(np.float32)
    # no top view there: the overlay alone, as if over white
    base[measured & ~seen] = 255.0
    grey = (base @ _LUMINANCE)[..., np.newaxis]
    colours = diverging_colours(dz[coloured], limit).astype(np.float32)
    base[coloured] = grey[coloured] + opacity * (colours - grey[coloured])
    base[below] = veiled(base[below] + _FADE * (grey[below] - base[below]), opacity)
    rgba = np.zeros((*dz.shape, 4), dtype=np.uint8)
    rgba[..., :3] = np.rint(base)
    rgba[..., 3] = np.where(seen | measured, 255, 0)
    rgba[rgba[..., 3] == 0] = 0
    return rgba, grey[measured][:, 0]


def _nearest_cells(of: Grid, on: Grid) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column on the grid ``on`` below the centre of each row and column of ``of``; may lie outside."""
    x = of.west + (np.arange(of.columns) + 0.5) * of.cell
    y = of.north - (np.arange(of.rows) + 0.5) * of.cell
    column = np.floor((x - on.west) / on.cell + 1e-6)
    row = np.floor((on.north - y) / on.cell + 1e-6)
    return row.astype(np.int64), column.astype(np.int64)
