"""The annotated map of a heatmap. Every part has its own place in inches, so that none covers another."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import cast

import geopandas as gpd
import numpy as np
import shapely
from affine import Affine
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from PIL import Image
from rasterio.features import rasterize, shapes
from scipy import ndimage

from ...interface.language import ENGLISH
from ..core.errors import EngineError
from ..grid.grid import Grid
from .heatmap_image import Heatmap
from .map_parts import (
    BODY,
    INK,
    SMALL,
    Sheet,
    draw_coordinates,
    draw_image,
    draw_key,
    draw_legend,
    draw_north,
    draw_scale_bar,
    wrap,
)
from .palette import veiled
from .picture_words import fonts, picture_language, say
from .unseen import draw_unseen, draw_unseen_key

DPI = 150
_MAX_PIXELS = 2000  # longest side of the picture that is drawn
_MAX_LABELS = 40  # most zone ids on a map
_LEFT, _RIGHT, _BOTTOM, _TOP = 0.5, 0.4, 0.45, 0.15  # margins around the map, inches
_COLUMN = 2.6  # width of the legend's column next to a tall map
_FOOTER = 1.0  # height of the legend's band below a wide map
_TITLE, _TITLE_LINE, _NOTE_LINE = 13.0, 0.25, 0.19


@dataclass(frozen=True)
class Layout:
    """Sizes in inches: of the figure, of the map and from the figure's lower left to it; is the legend next to it?"""

    width: float
    height: float
    map_left: float
    map_bottom: float
    map_width: float
    map_height: float
    at_the_side: bool


def plan_layout(width_m: float, height_m: float, header: float) -> Layout:
    """The legend lies below a wide slope and next to a tall one; a very long slope gets a longer figure.

    Args:
        header: inches for title and notes above the map.
    """
    aspect = width_m / height_m
    if aspect >= 1.25:
        # nine inches, and for a strip as much more as makes it an inch high, up to 18
        map_width = min(max(9.0, aspect), 18.0)
        map_height = map_width / aspect
        width, height = _LEFT + map_width + _RIGHT, _FOOTER + _BOTTOM + map_height + _TOP + header
        return Layout(width, height, _LEFT, _FOOTER + _BOTTOM, map_width, map_height, at_the_side=False)
    map_height = min(max(7.0, 1.0 / aspect), 14.0)
    map_width = map_height * aspect
    # a narrow map stands in the middle of what the legend leaves it
    width = max(_LEFT + map_width + _RIGHT + _COLUMN, 6.5)
    left = _LEFT + (width - _LEFT - map_width - _RIGHT - _COLUMN) / 2
    return Layout(width, _BOTTOM + map_height + _TOP + header, left, _BOTTOM, map_width, map_height, at_the_side=True)


def make_figure(
    heatmap: Heatmap,
    *,
    zones: gpd.GeoDataFrame | None = None,
    epochs: tuple[str, str] = ("", ""),
    name: str = "",
) -> Figure:
    """The annotated map; see ``heatmap.write_heatmap_png``."""
    west, south, east, north = heatmap.grid.bounds
    layout = plan_layout(east - west, north - south, 0.0)
    sheet = Sheet(layout.width, layout.height, DPI)
    room = layout.width - _LEFT - _RIGHT
    header = [
        (line, size, weight, step)
        for text, size, weight, step in (
            (_title(heatmap.words.title, epochs, name), _TITLE, "bold", _TITLE_LINE),
            (_notes(heatmap, zones), BODY, "normal", _NOTE_LINE),
        )
        for line in wrap(text, room, partial(sheet.text_width, size=size, weight=weight))
    ]
    layout = plan_layout(east - west, north - south, 0.3 + sum(step for *_, step in header))
    sheet.resize(layout.width, layout.height)
    y = layout.height - 0.3
    for line, size, weight, step in header:
        sheet.text(_LEFT, y, line, size, weight=weight)
        y -= step

    axes = sheet.axes(layout.map_left, layout.map_bottom, layout.map_width, layout.map_height, "map")
    picture, factor = shrunk(heatmap.rgba, _MAX_PIXELS)
    draw_image(axes, picture, Grid(west, north, heatmap.grid.cell * factor, *picture.shape[:2]))
    inches_a_metre = layout.map_width / (east - west)
    draw_coordinates(axes, heatmap.grid, inches_a_metre)
    outlined = zones is not None and len(zones) > 0
    if zones is not None and outlined:
        _draw_zones(axes, layout, heatmap, zones)
    upwards = say(heatmap.words.upwards)
    unseen = heatmap.unseen is not None and draw_unseen(axes, heatmap.unseen, inches_a_metre)
    if layout.at_the_side:
        x, top = layout.width - _RIGHT - _COLUMN + 0.35, layout.map_bottom + layout.map_height
        draw_north(sheet, x + 0.12, top - 0.5, upwards)
        draw_scale_bar(sheet, x, top - 1.0, 1.8, inches_a_metre)
        draw_legend(sheet, (x, top - 4.6, 0.22, 2.6), heatmap, vertical=True)
        keys = x, top - 5.15
    else:
        draw_north(sheet, _LEFT + 0.12, 0.4, upwards)
        draw_scale_bar(sheet, _LEFT + 0.6, 0.55, 2.2, inches_a_metre)
        draw_legend(sheet, (_LEFT + 3.5, 0.5, 3.2, 0.2), heatmap, vertical=False)
        keys = _LEFT + 7.0, 0.75
    grey = veiled(heatmap.backdrop, heatmap.opacity) / 255.0
    draw_key(sheet, *keys, [say(line) for line in heatmap.words.veil], face=f"{grey:.4f}")
    if unseen:
        draw_unseen_key(sheet, keys[0], keys[1] - 0.28, backdrop=heatmap.backdrop)
    if outlined:
        draw_key(sheet, keys[0], keys[1] - (0.52 if unseen else 0.34), [say(heatmap.words.outline)], edge=INK)
    return sheet.figure


def check_png(path: Path) -> None:
    """Raise EngineError unless ``path`` is a whole picture that is not of one colour."""
    with Image.open(path) as picture:
        extrema = cast("tuple[tuple[int, int], ...]", picture.convert("RGB").getextrema())
    if all(low == high for low, high in extrema):
        raise EngineError(f"{path.name} is blank")


def shrunk(rgba: NDArray[np.uint8], longest: int) -> tuple[NDArray[np.uint8], int]:
    """``rgba`` averaged in squares of ``factor`` pixels so that no side is longer than ``longest``; and the factor.

    The last square of a row or column may reach beyond the picture; it is transparent there.
    """
    factor = math.ceil(max(rgba.shape[:2]) / longest)
    if factor == 1:
        return rgba, 1
    rows, columns = (math.ceil(n / factor) for n in rgba.shape[:2])
    whole = np.zeros((rows * factor, columns * factor, 4), dtype=np.float32)
    whole[: rgba.shape[0], : rgba.shape[1]] = rgba
    whole[..., :3] *= whole[..., 3:]  # transparent pixels must not darken the average
    total = whole.reshape(rows, factor, columns, factor, 4).sum(axis=(1, 3))
    total[..., :3] /= np.maximum(total[..., 3:], 1.0)
    total[..., 3] /= factor**2
    return np.rint(total).astype(np.uint8), factor


def _title(what: str, epochs: tuple[str, str], name: str) -> str:
    # spaces that do not break keep both on one line
    dates = say("{0} to {1}").replace(" ", "\u00a0").format(*epochs) if all(epochs) else ""
    comma = ", " if picture_language() == ENGLISH else "，"
    return comma.join(part for part in (say(what), name, dates) if part)


def _notes(heatmap: Heatmap, zones: gpd.GeoDataFrame | None) -> str:
    if heatmap.words.notes:
        return say(heatmap.words.notes)
    level = ""
    if math.isfinite(heatmap.level):
        words = say(" (median {0} m)").format(f"{heatmap.level:.3f}")
        level = words[:1] + words[1:].replace(" ", "\u00a0")
    if not heatmap.significant_cells:
        return say("No change above the level of detection{0}.").format(level)
    sentences = [say("Red is lowered and blue is raised by more than the level of detection{0}.").format(level)]
    if zones is not None:
        count = "No zones." if not len(zones) else "1 zone." if len(zones) == 1 else "{0} zones."
        sentences.append(say(count).format(len(zones)))
    return ("" if sentences[0].endswith("。") else " ").join(sentences)


def _draw_zones(axes: Axes, layout: Layout, heatmap: Heatmap, zones: gpd.GeoDataFrame) -> None:
    """Outer rings and, as far as they find room, ids: the most severe first, next to the zone where it has no room."""
    west, south, east, _ = heatmap.grid.bounds
    scale = layout.map_width / (east - west)
    rings = outlines(np.asarray(zones.geometry), heatmap.grid.bounds, 0.015 / scale)
    axes.add_collection(LineCollection(rings, colors="white", linewidths=1.8, alpha=0.6, zorder=2), autolim=False)
    axes.add_collection(LineCollection(rings, colors=INK, linewidths=0.8, zorder=3), autolim=False)
    placed: list[tuple[float, float, float, float]] = []
    # a map that is hardly wider than the ids has them on the white paper next to it
    narrow = layout.at_the_side and layout.map_width < 1.0
    room = layout.map_width + (0.8 if narrow else 0.0), layout.map_height
    boxes = (shapely.bounds(np.asarray(zones.geometry))[:_MAX_LABELS] - (west, south, west, south)) * scale
    points = shapely.get_coordinates(shapely.point_on_surface(np.asarray(zones.geometry)))[:_MAX_LABELS]
    inner = (points - (west, south)) * scale
    for name, extent, point in zip(zones["zone_id"], boxes, inner, strict=False):
        width, height = 0.078 * len(name), 0.13
        roomy = extent[2] - extent[0] > 2.5 * width and extent[3] - extent[1] > 4 * height
        # on a large zone, above a small one, which the id would hide
        anchor = (point[0], point[1]) if roomy else ((extent[0] + extent[2]) / 2, extent[3] + 0.6 * height)
        if narrow:
            anchor = layout.map_width + 0.35, point[1]
        box = free_place(anchor, width, height, placed, room)
        if box is None:
            continue
        placed.append(box)
        centre = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
        x, y = west + centre[0] / scale, south + centre[1] / scale
        if narrow or math.dist(centre, anchor) > 0.01:
            tip = west + point[0] / scale, south + point[1] / scale
            axes.plot((tip[0], x), (tip[1], y), color=INK, lw=0.6, zorder=4, clip_on=False)
        axes.text(
            x,
            y,
            name,
            fontproperties=fonts(SMALL, "bold"),
            color=INK,
            ha="center",
            va="center",
            zorder=5,
            path_effects=[withStroke(linewidth=2.2, foreground="white")],
        )


def outlines(zones: NDArray[np.object_], bounds: tuple[float, float, float, float], pixel: float) -> list[NDArray]:
    """Outer rings of the zones as the eye sees them: on pixels (metres), closed over holes and gaps of two of them.

    Zones under vegetation consist of hundreds of scattered cells, whose own edges would blacken the map.
    """
    west, south, east, north = bounds
    shape = max(1, math.ceil((north - south) / pixel)), max(1, math.ceil((east - west) / pixel))
    affine = Affine(pixel, 0.0, west, 0.0, -pixel, north)
    burnt = rasterize(
        zip(zones, range(1, len(zones) + 1), strict=True), shape, transform=affine, all_touched=True, dtype=np.int32
    )
    wide = ndimage.maximum_filter(np.pad(burnt, 2), 3)
    closed = np.where(ndimage.minimum_filter(wide > 0, 3), wide, 0)[2:-2, 2:-2].astype(np.int32)
    parts = [
        (label, np.array(outline["coordinates"][0]))
        for outline, label in shapes(closed, mask=closed > 0, connectivity=4, transform=affine)
    ]
    # of a zone in many parts, those of a few pixels would be blots
    areas = np.array([shapely.Polygon(ring).area for _, ring in parts])
    owners = np.array([int(label) for label, _ in parts], dtype=np.int64)
    largest = np.zeros(len(zones) + 1)
    np.maximum.at(largest, owners, areas)
    drawn = areas >= np.minimum(largest[owners], 12.0 * pixel**2)
    return [ring for (_, ring), keep in zip(parts, drawn, strict=True) if keep]


def free_place(
    anchor: tuple[float, float],
    width: float,
    height: float,
    taken: list[tuple[float, float, float, float]],
    room: tuple[float, float],
) -> tuple[float, float, float, float] | None:
    """Box (left, bottom, right, top; inches) at or near ``anchor`` within ``room`` that overlaps none of ``taken``."""
    offsets = [(0.0, 0.0)]
    for ring in (1.0, 1.8, 2.6):
        for turn in (0, 4, 2, 6, 1, 3, 5, 7):
            angle = turn * math.pi / 4
            offsets.append((ring * (width * 0.7 + 0.06) * math.cos(angle), ring * (height + 0.08) * math.sin(angle)))
    for dx, dy in offsets:
        x, y = anchor[0] + dx, anchor[1] + dy
        box = x - width / 2, y - height / 2, x + width / 2, y + height / 2
        within = box[0] >= 0 and box[1] >= 0 and box[2] <= room[0] and box[3] <= room[1]
        if within and not any(box[0] < t[2] and t[0] < box[2] and box[1] < t[3] and t[1] < box[3] for t in taken):
            return box
    return None
