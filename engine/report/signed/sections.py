"""Sections through zones: heights of both surveys where they are kept, and the change with its level of detection."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import geopandas as gpd
import matplotlib
import numpy as np
from shapely import LineString, Point, get_coordinates
from shapely.geometry.base import BaseGeometry

from ...core.arrays import Float
from ...maps.map_parts import INK, Sheet
from ...maps.picture_words import fonts, say
from ...zones.profile_lines import ProfileLine, steepest_lines
from ...zones.profiles import take_profile
from ..charts import draw_difference, draw_heights, finish
from .rasters import Surface

_INCH_MM = 25.4
_WIDTH_MM = 176.0


@dataclass(frozen=True)
class Section:
    """A ``line`` with the cells along it by the columns of a table of profiles; ``span`` of the zone on it, metres."""

    name: str
    line: LineString
    columns: Mapping[str, Float]
    span: tuple[float, float] | None = None

    @property
    def measured(self) -> bool:
        return bool(np.isfinite(self.columns["dz_m"]).any())


def zone_sections(surface: Surface, zones: gpd.GeoDataFrame) -> list[Section]:
    """A section down each of the zones."""
    layers = surface.layers
    lines = steepest_lines(zones, layers.height_to, layers.dz, layers.grid, len(zones), layers.layout)
    return [_section(surface, line, shape) for line, shape in zip(lines, zones.geometry, strict=True)]


def given_sections(surface: Surface, lines: Sequence[ProfileLine]) -> list[Section]:
    """Sections along other lines."""
    return [_section(surface, line, None) for line in lines]


def _section(surface: Surface, line: ProfileLine, zone: BaseGeometry | None) -> Section:
    cells = take_profile(line, surface.layers)
    columns: dict[str, Float] = {
        "distance_m": cells.distance,
        "height_from_m": cells.height_from.astype(np.float64),
        "height_to_m": cells.height_to.astype(np.float64),
        "dz_m": cells.dz.astype(np.float64),
        "level_m": cells.level.astype(np.float64),
        "significant": cells.significant.astype(np.float64),
    }
    span = None
    if zone is not None:
        met = [line.geometry.project(Point(end)) for end in get_coordinates(line.geometry.intersection(zone))]
        span = (min(met), max(met)) if met else None
    return Section(line.name, line.geometry, columns, span)


def section_drawing(section: Section, epochs: tuple[str, str], letter: str, height_mm: float) -> bytes:
    """The section as SVG; the zone is shaded, ``letter`` names the ends of the line on the map."""
    width, height = _WIDTH_MM / _INCH_MM, height_mm / _INCH_MM
    sheet = Sheet(width, height)
    room = height - 0.62
    with_heights = bool(np.isfinite(section.columns["height_to_m"]).any())
    lower = room * (0.42 if with_heights else 1.0)
    below = sheet.axes(0.62, 0.42, width - 0.75, lower)
    drawn = [below]
    if with_heights:
        above = sheet.axes(0.62, 0.42 + lower + 0.08, width - 0.75, room - lower - 0.08)
        draw_heights(above, section.columns, epochs)
        finish(above, "", "height (m)")
        above.set_xticklabels([])
        drawn.append(above)
    if section.measured:
        draw_difference(below, section.columns)
    finish(below, "distance along the line (m)", "change (m)")
    for axes in drawn:
        axes.set_xlim(0, section.line.length)
        if section.span is not None:
            axes.axvspan(*section.span, color="#000000", alpha=0.06, lw=0, zorder=0)
    top = drawn[-1]
    ends = ((0.008, 0.05, letter, "left", "bottom"), (0.992, 0.95, f"{letter}′", "right", "top"))
    for x, y, words, side, edge in ends if letter else ():
        top.text(x, y, words, transform=top.transAxes, ha=side, va=edge, fontproperties=fonts(9, "bold"), color=INK)
    if not section.measured:
        top.text(0.5, 0.5, say("not measured"), transform=top.transAxes, ha="center", fontproperties=fonts(9))
    sheet.figure.align_ylabels(drawn)
    return as_svg(sheet)


def as_svg(sheet: Sheet) -> bytes:
    """A drawing with letters as shapes, which look the same with any fonts."""
    stream = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "slopewatch", "svg.fonttype": "path"}):
        sheet.figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": "SlopeWatch"})
    return stream.getvalue()
