"""Maps of the report to sign: the slope with its zones, lines and footprints, and one for each zone's sheet."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import geopandas as gpd
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ...grid.grid import Grid
from ...maps.figure import free_place, outlines
from ...maps.map_parts import (
    INK,
    PNG_OPTIONS,
    SMALL,
    Sheet,
    draw_coordinates,
    draw_image,
    draw_key,
    draw_north,
    draw_scale_bar,
    draw_signed_bar,
)
from ...maps.palette import diverging_colours
from ...maps.picture_words import fonts, say
from ...maps.unseen import draw_unseen, draw_unseen_key
from .rasters import Surface
from .screened_relief import ScreenedRelief

_DPI = 200
_INCH_MM = 25.4
_LEFT, _TOP, _RIGHT = 0.3, 0.08, 0.08  # inches around the map
_FOOT, _NARROW_FOOT = 0.95, 1.5  # inches below it, for scale, north, colours and keys
_NARROW = 5.0  # inches: on a narrower map the keys stand below the scale
_MARGIN_SHARE, _MIN_MARGIN_M = 0.35, 3.0  # around a zone
_SCREENED, _LINE, _FOOTPRINT, _MOTION = "#7a3fa0", "#111111", "#0b6e4f", "#0b6e4f"
_MAX_LABELS = 40


@dataclass(frozen=True)
class MapLayers:
    """What maps show over the change: tables of ``zones``, ``screened`` zones and ``footprints`` of volumes, ``lines``
    of sections by their letters or names, and motion ``vectors`` as (x, y, east, north), metres. ``names`` of zones and
    footprints in the key. ``marks`` are dots (x, y, colour), and ``marked`` says what their colours mean.
    """

    zones: gpd.GeoDataFrame
    screened: gpd.GeoDataFrame | None = None
    footprints: gpd.GeoDataFrame | None = None
    lines: Sequence[tuple[str, BaseGeometry]] = ()
    vectors: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    names: tuple[str, str] = ("zone of change", "footprint of the volume")
    marks: Sequence[tuple[float, float, str]] = ()
    marked: Sequence[tuple[str, str]] = ()


def slope_map(surface: Surface | ScreenedRelief | None, layers: MapLayers, width_mm: float, height_mm: float) -> bytes:
    """The whole slope as PNG; without a surface only the outlines."""
    if surface is not None:
        bounds = surface.grid.bounds
    else:
        shapes = [frame.total_bounds for frame in (layers.zones, layers.screened) if frame is not None and len(frame)]
        if not shapes:
            return b""
        found = np.array(shapes)
        bounds = (*found[:, :2].min(axis=0).tolist(), *found[:, 2:].max(axis=0).tolist())
    return _map(surface, layers, _widened(bounds, width_mm, height_mm, 0.02), (width_mm, height_mm), all_ids=True)


def zone_map(
    surface: Surface | None, layers: MapLayers, zone: BaseGeometry, width_mm: float, height_mm: float
) -> bytes:
    """The surroundings of one zone as PNG."""
    west, south, east, north = zone.bounds
    margin = max(_MIN_MARGIN_M, _MARGIN_SHARE * max(east - west, north - south))
    bounds = west - margin, south - margin, east + margin, north + margin
    return _map(surface, layers, _widened(bounds, width_mm, height_mm, 0.0), (width_mm, height_mm), all_ids=False)


def _widened(
    bounds: tuple[float, float, float, float], width_mm: float, height_mm: float, margin: float
) -> tuple[float, float, float, float]:
    """Bounds around the same middle with the sides of the map on a sheet of this size."""
    aspect = (width_mm / _INCH_MM - _LEFT - _RIGHT) / (height_mm / _INCH_MM - _foot(width_mm / _INCH_MM) - _TOP)
    west, south, east, north = bounds
    wide, tall = max(east - west, 1e-3) * (1 + 2 * margin), max(north - south, 1e-3) * (1 + 2 * margin)
    wide, tall = max(wide, tall * aspect), max(tall, wide / aspect)
    x, y = (west + east) / 2, (south + north) / 2
    return x - wide / 2, y - tall / 2, x + wide / 2, y + tall / 2


def _map(
    surface: Surface | ScreenedRelief | None,
    layers: MapLayers,
    bounds: tuple[float, float, float, float],
    size_mm: tuple[float, float],
    *,
    all_ids: bool,
) -> bytes:
    width, height = size_mm[0] / _INCH_MM, size_mm[1] / _INCH_MM
    sheet = Sheet(width, height, _DPI)
    foot = _foot(width)
    wide, tall = width - _LEFT - _RIGHT, height - foot - _TOP
    axes = sheet.axes(_LEFT, foot, wide, tall, "map")
    west, south, east, north = bounds
    inches = wide / (east - west)
    if surface is not None:
        image, grid = surface.picture(surface.window(bounds))
        draw_image(axes, image, grid, "nearest")
    draw_coordinates(axes, Grid(west, north, (east - west) / 1000, max(1, round(1000 * tall / wide)), 1000), inches)
    axes.set(xlim=(west, east), ylim=(south, north))
    hatched = surface is not None and surface.unseen is not None and draw_unseen(axes, surface.unseen, inches)
    _draw_shapes(axes, layers, bounds, inches)
    _draw_ids(axes, layers, bounds, inches, all_ids=all_ids)
    low = foot - _FOOT
    draw_north(sheet, 0.18, low + 0.12)
    draw_scale_bar(sheet, 0.45, low + 0.34, min(1.3, 0.26 * width), inches)
    bar_at = min(2.15, 0.45 * width)
    if surface is not None and surface.limit is not None:
        values = np.linspace(-surface.limit, surface.limit, 401)
        draw_signed_bar(sheet, (bar_at, low + 0.42, 1.5, 0.1), diverging_colours(values, surface.limit), surface.limit)
        sheet.text(bar_at + 0.75, low + 0.61, say(surface.legend), ha="center")
    keys = _keys(layers)
    places = [_key_place(number, width) for number in range(len(keys) + 1)]
    for (words, colour), place in zip(keys, places, strict=False):
        draw_key(sheet, *place, [words], edge=colour, width=0.18)
    if hatched:
        draw_unseen_key(sheet, *places[len(keys)], 0.18)
    stream = io.BytesIO()
    sheet.figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": "SlopeWatch"}, pil_kwargs=PNG_OPTIONS)
    return stream.getvalue()


def _key_place(number: int, width: float) -> tuple[float, float]:
    """Left edge and middle, inches, of an entry of the legend on a sheet of this width."""
    if width >= _NARROW:
        return 4.0 + 1.6 * (number // 4), 0.64 - 0.185 * (number % 4)
    return 0.1 + 1.75 * (number // 3), 0.47 - 0.19 * (number % 3)


def _draw_shapes(axes: Axes, layers: MapLayers, bounds: tuple[float, float, float, float], inches: float) -> None:
    pixel = 0.012 / inches
    for frame, colour, style, width in (
        (layers.footprints, _FOOTPRINT, (0, (4, 2)), 0.8),
        (layers.screened, _SCREENED, (0, (1.5, 1.5)), 1.1),
        (layers.zones, INK, "solid", 1.0),
    ):
        near = [] if frame is None else [g for g in frame.geometry if _meets(g, bounds)]
        if not near:
            continue
        rings = outlines(np.array(near, dtype=object), bounds, pixel)
        axes.add_collection(LineCollection(rings, colors="white", linewidths=width + 1.0, alpha=0.6, zorder=2), False)
        axes.add_collection(LineCollection(rings, colors=colour, linewidths=width, linestyles=style, zorder=3), False)
    for x, y, colour in layers.marks:
        axes.plot(x, y, "o", color=colour, ms=7.0, mec="white", mew=0.8, alpha=0.9, zorder=4)
    halo = [withStroke(linewidth=2.0, foreground="white")]
    for name, line in layers.lines:
        x, y = np.array(line.coords).T[:2]
        axes.plot(x, y, color=_LINE, lw=0.9, ls=(0, (6, 2, 1, 2)), zorder=4, path_effects=halo)
        if name:
            for at, letter in ((0, name), (-1, f"{name}′")):
                axes.text(
                    x[at], y[at], letter, fontproperties=fonts(SMALL, "bold"), ha="center", va="center", zorder=6,
                    path_effects=halo, clip_on=True,
                )  # fmt: skip
    _draw_vectors(axes, layers.vectors, bounds)


def _draw_vectors(axes: Axes, vectors: NDArray[np.float64], bounds: tuple[float, float, float, float]) -> None:
    """Arrows, the longest of them a twelfth of the map's width long."""
    if not len(vectors):
        return
    x, y, east, north = vectors.T
    near = (x >= bounds[0]) & (x <= bounds[2]) & (y >= bounds[1]) & (y <= bounds[3])
    longest = float(np.hypot(east, north)[near].max(initial=0.0))
    if longest > 0:
        times = (bounds[2] - bounds[0]) / 12.0 / longest
        axes.quiver(
            x[near], y[near], times * east[near], times * north[near], angles="xy", scale_units="xy", scale=1.0,
            color=_MOTION, width=0.0035, zorder=5,
        )  # fmt: skip


def _draw_ids(
    axes: Axes, layers: MapLayers, bounds: tuple[float, float, float, float], inches: float, *, all_ids: bool
) -> None:
    """Ids of the zones, and on the map of the slope those of the screened ones, each where it hides nothing else."""
    west, south, east, north = bounds
    room = (east - west) * inches, (north - south) * inches
    taken: list[tuple[float, float, float, float]] = []
    tables: Iterable[tuple[gpd.GeoDataFrame | None, str]] = ((layers.zones, INK), (layers.screened, _SCREENED))
    for frame, colour in tables:
        if frame is None:
            continue
        for name, shape in list(zip(frame["zone_id"], frame.geometry, strict=True))[:_MAX_LABELS]:
            if not _meets(shape, bounds):
                continue
            box_of = (np.array(shape.bounds) - (west, south, west, south)) * inches
            width, height = 0.078 * len(name), 0.13
            anchor = (float(box_of[0] + box_of[2]) / 2, float(box_of[3]) + 0.7 * height)
            box = free_place(anchor, width, height, taken, room)
            if box is None:
                continue
            taken.append(box)
            x, y = west + (box[0] + box[2]) / 2 / inches, south + (box[1] + box[3]) / 2 / inches
            axes.text(
                x, y, name, fontproperties=fonts(SMALL, "bold" if all_ids else "normal"), color=colour, ha="center",
                va="center", zorder=7, path_effects=[withStroke(linewidth=2.2, foreground="white")], parse_math=False,
            )  # fmt: skip


def _foot(width: float) -> float:
    """Inches below the map on a sheet of this width."""
    return _FOOT if width >= _NARROW else _NARROW_FOOT


def _keys(layers: MapLayers) -> list[tuple[str, str]]:
    """What the outlines mean, with their colours."""
    keys = [(say(layers.names[0]), INK)] if len(layers.zones) else []
    if layers.screened is not None and len(layers.screened):
        keys.append((say("screened zone (by its shape)"), _SCREENED))
    if layers.footprints is not None and len(layers.footprints):
        keys.append((say(layers.names[1]), _FOOTPRINT))
    if layers.lines:
        keys.append((say("line of a section"), _LINE))
    if len(layers.vectors):
        keys.append((say("motion"), _MOTION))
    return keys + [(say(words), colour) for words, colour in layers.marked]


def _meets(shape: BaseGeometry, bounds: tuple[float, float, float, float]) -> bool:
    return not shape.is_empty and bool(shapely.intersects(shape, shapely.box(*bounds)))
