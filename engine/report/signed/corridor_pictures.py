"""Pictures of a corridor: the map with its slopes, and the road drawn straight with each slope at its chainage."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import geopandas as gpd
import numpy as np
from matplotlib.patches import Rectangle
from shapely.geometry.base import BaseGeometry

from ...maps.map_parts import INK, SMALL, Sheet
from ...maps.picture_words import fonts, say
from .details import chainage_text
from .maps import MapLayers, slope_map
from .sections import as_svg

ATTENTION_COLOURS = ("#6b8f71", "#e0b400", "#e07b00", "#b2182b")
"""Of an attention of 0, 1, 2, and 3 or more."""
_WORDS = ("attention 0", "attention 1", "attention 2", "attention 3 or more")
_INCH_MM = 25.4
_ROAD_MM, _FRAME_MM = 17.0, 5.0  # of a road on the strip, and of the key below
_MOST_ROADS = 4
_LEFT_IN, _RIGHT_IN = 0.75, 0.15
_LEVELS = 3  # of names above a road, so that they do not overlap
_LETTER_IN = 0.075
_LEAST_BAR = 0.004  # of the strip's width: a short slope on a long road is still seen
_MARGIN = 0.03


@dataclass(frozen=True)
class Span:
    """Where a slope lies on its road, metres of chainage, and its attention; None of one that failed."""

    slope: str
    route: str
    begin: float
    end: float
    attention: int | None


def colour_of(attention: int | None) -> str:
    """Grey for a slope that failed."""
    if attention is None:
        return "#8c959f"
    return ATTENTION_COLOURS[min(max(attention, 0), len(ATTENTION_COLOURS) - 1)]


def corridor_map(
    zones: gpd.GeoDataFrame,
    regions: Sequence[tuple[str, BaseGeometry]],
    attentions: dict[str, int],
    spans: Sequence[Span],
    size_mm: tuple[float, float],
) -> bytes:
    """Regions of the slopes with their names and chainages, in the colours of their attention, and the zones within.

    A slope without a region is shown by the extent of its zones. Empty where nothing has a place. What the colours mean
    is said here only where there are no ``spans``, whose picture says it.
    """
    places = {span.slope: chainage_text(span.begin) for span in spans}
    shapes = dict(regions)
    if len(zones) and "slope" in zones:
        for slope, own in zones.groupby("slope", sort=False):
            shapes.setdefault(str(slope), own.union_all().envelope)
    if not shapes:
        return slope_map(None, MapLayers(zones, names=("zone of change", "zone")), *size_mm)
    names = [f"{slope} {places[slope]}" if slope in places else slope for slope in shapes]
    frame = gpd.GeoDataFrame({"zone_id": names}, geometry=list(shapes.values()), crs=zones.crs)
    middles = [shape.centroid for shape in shapes.values()]
    marks = [
        (at.x, at.y, colour_of(attentions.get(slope))) for slope, at in zip(shapes, middles, strict=True)
    ]  # fmt: skip
    layers = MapLayers(
        frame, None, zones if len(zones) else None, names=("region of a slope", "zone"), marks=marks,
        marked=() if spans else _key(marks),
    )  # fmt: skip
    return slope_map(None, layers, *size_mm)


def strip_height(spans: Sequence[Span]) -> float:
    """Millimetres that ``road_strip`` is high; 0 where there is nothing to draw."""
    count = min(len({span.route for span in spans}), _MOST_ROADS)
    return count * _ROAD_MM + _FRAME_MM if count else 0.0


def road_strip(spans: Sequence[Span], width_mm: float) -> bytes:
    """The first roads drawn straight, each slope a bar from its first to its last chainage, as SVG."""
    roads = {route: list(own) for route, own in itertools.groupby(sorted(spans, key=_by_route), _by_route)}
    height = strip_height(spans) / _INCH_MM
    sheet = Sheet(width_mm / _INCH_MM, height)
    wide = width_mm / _INCH_MM - _LEFT_IN - _RIGHT_IN
    for number, (route, own) in enumerate(list(roads.items())[:_MOST_ROADS]):
        low = height - (number + 1) * _ROAD_MM / _INCH_MM
        _draw_road(sheet, (low, wide), route, own)
    x = _LEFT_IN
    for words, colour in _key([(0.0, 0.0, colour_of(span.attention)) for span in spans]):
        sheet.shape(Rectangle((0, 0), 0.14, 0.09, facecolor=colour, lw=0), x, 0.04)
        text = say(words)
        sheet.text(x + 0.2, 0.085, text)
        x += 0.2 + sheet.text_width(text, SMALL) + 0.25
    return as_svg(sheet)


def _by_route(span: Span) -> str:
    return span.route


def _key(marks: Sequence[tuple[float, float, str]]) -> list[tuple[str, str]]:
    """The colours that are there with their words."""
    there = {colour for _, _, colour in marks}
    known = [*zip(_WORDS, ATTENTION_COLOURS, strict=True), ("not computed", colour_of(None))]
    return [(words, colour) for words, colour in known if colour in there]


def _draw_road(sheet: Sheet, place: tuple[float, float], route: str, spans: Sequence[Span]) -> None:
    low, wide = place
    first, last = min(span.begin for span in spans), max(span.end for span in spans)
    margin = max(_MARGIN * (last - first), 5.0)
    axes = sheet.axes(_LEFT_IN, low + 0.2, wide, _ROAD_MM / _INCH_MM - 0.22)
    axes.set(xlim=(first - margin, last + margin), ylim=(0.0, 1.0))
    axes.spines[["top", "left", "right"]].set_visible(False)
    axes.spines["bottom"].set(color=INK, linewidth=1.6)
    axes.set_yticks([])
    axes.locator_params(axis="x", nbins=6)
    ticks = [tick for tick in axes.get_xticks() if first - margin <= tick <= last + margin]
    axes.set_xticks(ticks, [chainage_text(tick) for tick in ticks])
    axes.tick_params(axis="x", colors="#57606a", length=3, width=0.6, pad=1.5)
    for label in axes.get_xticklabels():
        label.set_fontproperties(fonts(SMALL))
    sheet.text(_LEFT_IN - 0.08, low + 0.22, route or "–", ha="right")
    metres = last - first + 2 * margin
    ends = [-np.inf] * _LEVELS
    for span in sorted(spans, key=lambda s: (s.begin, s.end)):
        length = max(span.end - span.begin, _LEAST_BAR * metres)
        middle = (span.begin + span.end) / 2
        axes.add_patch(
            Rectangle((middle - length / 2, 0.0), length, 0.2, facecolor=colour_of(span.attention), lw=0, zorder=3)
        )
        half = 0.5 * _LETTER_IN * (len(span.slope) + 1) * metres / wide
        level = next((n for n in range(_LEVELS) if middle - half > ends[n]), None)
        if level is not None:
            ends[level] = middle + half
            axes.text(
                middle, 0.3 + 0.24 * level, span.slope, ha="center", va="bottom", fontproperties=fonts(SMALL),
                color=INK, parse_math=False,
            )  # fmt: skip
