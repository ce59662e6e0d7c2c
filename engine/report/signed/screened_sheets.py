"""Sheets of screened zones, two a page: map and section of the labelled points, figures, place, review."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import geopandas as gpd
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from shapely import LineString, Point, get_coordinates
from shapely.geometry.base import BaseGeometry

from ...grid.grid import Grid
from ...maps.figure import outlines
from ...maps.map_parts import INK, PNG_OPTIONS, SMALL, Sheet, draw_coordinates, draw_image
from ...maps.picture_words import fonts
from ...maps.picture_words import say as say_in_picture
from ...maps.relief import hillshade
from ...zones.profile_lines import steepest_lines
from ..charts import finish
from ..figures_in_text import figure, percent, say, words_of
from ..maps import GAP, closed
from ..record_shape import inside
from ..reviews import Review
from . import blocks
from .blocks import Block, Document
from .details import place_text
from .screened_ground import ScreenedGround, screened_ground, surroundings
from .source import Source

MOST_SHEETS, MOST_SHEETS_OF_A_PAIR = 8, 2
_A_PAGE = 2
_DPI, _INCH_MM = 200, 25.4
_MAP_MM, _SECTION_MM = (84.0, 72.0), (176.0, 34.0)
_CELL_M = 0.25
_COLOURS = ("#6e7781", "#2166ac", "#b2182b")  # of background, uplift and subsidence
_LEAST_BAND_M, _MOST_BAND_M, _SECTION_POINTS = 0.3, 1.5, 200  # on either side of a section's line, and within it
_SPACINGS_A_CELL, _GAP_CELLS = 1.3, 2.5
_DOT_SHARE, _LEAST_DOT, _MOST_DOT = 0.45, 1.6, 4.0  # of the points' spacing on the map; points
_MOST_DOTS = 6000
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"


def screened_sheets(document: Document, source: Source) -> list[Block]:
    """Pages with the screened zones of the highest confidence."""
    most = MOST_SHEETS if source.is_screening else MOST_SHEETS_OF_A_PAIR
    shown = source.screened.iloc[:most]
    if not len(shown):
        return []
    path = inside(source.folder, str(source.record["outputs"].get("screened", "")))
    grounds = screened_ground(path, list(shown.geometry)) if path is not None and path.is_file() else None
    known: Sequence[ScreenedGround | None] = grounds or [None] * len(shown)
    made: list[Block] = []
    pairs = list(zip(shown.to_dict("records"), known, strict=True))
    for start in range(0, len(pairs), _A_PAGE):
        parts: list[tuple[float, list[Block]]] = []
        for number, (row, ground) in enumerate(pairs[start : start + _A_PAGE], start):
            letter = _LETTERS[number % len(_LETTERS)]
            parts += _half_page(document, source, row, ground, letter)
        if len(pairs) - start < _A_PAGE:
            parts.append((12.5, [blocks.lines()]))
        made.append(blocks.sheet(parts, gap=2.5))
    return made


def _half_page(
    document: Document, source: Source, row: Mapping[str, Any], ground: ScreenedGround | None, letter: str
) -> list[tuple[float, list[Block]]]:
    zone_id = words_of(row, "zone_id")
    line = None if ground is None else _line(row["geometry"], zone_id, ground)
    left: list[Block] = []
    if ground is not None and len(ground.points):
        drawn = _map(row["geometry"], ground, line, letter)
        left = [document.picture(drawn, say(f"Map of {zone_id} and its surroundings"))]
    head = ", ".join(say(words) for words in (words_of(row, "kind"), words_of(row, "confidence")) if words)
    facts = [blocks.facts(_facts(row, ground), 1, gap=1.5, size=7.6)]
    parts: list[tuple[float, list[Block]]] = [
        (0, [blocks.heading(f"{say('Screened zone')} {zone_id}: {head}", 1, f"screened-{zone_id}")]),
        (8.0, [blocks.side_by_side(left, facts, 0.5, high=True)] if left else facts),
    ]
    if ground is not None and line is not None:
        band = _band(row["geometry"], ground, line)
        words = say(
            f"Section {letter}–{letter}′ through {zone_id}: ground points within {band:.1f} m of the line over the "
            "surface of the ground around. Blue: labelled raised; red: lowered; the zone is shaded."
        )
        parts.append(
            (4.3, [document.picture(_section(row["geometry"], ground, (line, band), letter), words, caption=words)])
        )
    return [*parts, (0, _review(source.screened_reviews.get(zone_id)))]


def _facts(row: Mapping[str, Any], ground: ScreenedGround | None) -> list[tuple[str, str]]:
    point = row["geometry"].representative_point()
    west, south, east, north = row["geometry"].bounds
    rows = [
        (say("Confidence"), say(words_of(row, "confidence"))),
        (say("Mean probability"), figure(row, "probability", digits=2)),
    ]
    for label, words in ((1, say("Points labelled raised")), (2, say("Points labelled lowered"))):
        share = None if ground is None else ground.share(label)
        rows.append((words, "–" if share is None else percent({"share": share}, "share")))
    rows += [
        (say("Ground points in it"), figure(row, "points", digits=0)),
        (say("Height over the trend, median"), figure(row, "height_med_m", "m", sign=True)),
        (say("Height over the trend, 95th perc."), figure(row, "height_p95_m", "m", sign=True)),
        (say("Area along the surface"), figure(row, "area_m2", "m²", 2)),
        (say("Extent east by north"), f"{east - west:.1f} × {north - south:.1f}\u00a0m"),
        (say("Inclination"), figure(row, "slope_deg", "°", 0)),
    ]
    if "confirmed" in row:
        rows += [
            (say("The change"), say(words_of(row, "confirmed"))),
            (say("Compared part of it"), percent(row, "compared_share")),
            (
                say("Of this, changed alike; against"),
                f"{percent(row, 'change_share')}; {percent(row, 'opposite_share')}",
            ),
            (say("Mean significant change"), figure(row, "dz_signif_m", "m", sign=True)),
        ]
    return [*rows, (say("Place (x, y)"), f"{point.x:.1f}, {point.y:.1f}"), (say("On the road"), place_text(row) or "–")]


def _review(review: Review | None) -> list[Block]:
    if review is None:
        return [blocks.facts([(say("Visited on"), ""), (say("by"), ""), (say("Finding"), "")], 3)]
    entries = [(say("Review"), say(review.status.capitalize())), (say("Reviewer"), review.reviewer)]
    return [blocks.facts([*entries, (say("Date"), review.date)], 3), *_said(review.remarks)]


def _said(remarks: str) -> list[Block]:
    return [blocks.paragraph(remarks[:300], small=True)] if remarks else []


def _heights(ground: ScreenedGround, bounds: tuple[float, float, float, float]) -> tuple[NDArray[np.float64], Grid]:
    """Mean height of the points in cells, which hold about a point at least; small gaps are closed."""
    west, south, east, north = bounds
    cell = max(_CELL_M, _SPACINGS_A_CELL * _spacing(ground, bounds))
    columns, rows = max(1, round((east - west) / cell)), max(1, round((north - south) / cell))
    grid = Grid(west, north, cell, rows, columns)
    column = np.clip(((ground.points[:, 0] - west) / cell).astype(np.int64), 0, columns - 1)
    row = np.clip(((north - ground.points[:, 1]) / cell).astype(np.int64), 0, rows - 1)
    index = row * columns + column
    count = np.bincount(index, minlength=rows * columns)
    total = np.bincount(index, weights=ground.points[:, 2], minlength=rows * columns)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return closed(mean.reshape(rows, columns), cell, max(GAP, _GAP_CELLS * cell)), grid


def _spacing(ground: ScreenedGround, bounds: tuple[float, float, float, float]) -> float:
    """Mean distance of the points, metres, were they spread evenly."""
    west, south, east, north = bounds
    return float(np.sqrt((east - west) * (north - south) / max(len(ground.points), 1)))


def _band(zone: BaseGeometry, ground: ScreenedGround, line: LineString) -> float:
    """How far from a section's line its points may lie, metres: farther where they are few."""
    density = 1.0 / max(_spacing(ground, surroundings(zone)), 1e-3) ** 2
    wanted = _SECTION_POINTS / (2.0 * density * max(line.length, 1e-3))
    return round(float(np.clip(wanted, _LEAST_BAND_M, _MOST_BAND_M)), 1)


def _line(zone: BaseGeometry, zone_id: str, ground: ScreenedGround) -> LineString | None:
    """Down the slope through the zone."""
    if not ground.inside.any():
        return None
    heights, grid = _heights(ground, surroundings(zone))
    table = gpd.GeoDataFrame({"zone_id": [zone_id]}, geometry=[zone])
    nothing = np.full(heights.shape, np.nan)
    (line,) = steepest_lines(table, heights, nothing, grid, 1)
    return line.geometry


def _map(zone: BaseGeometry, ground: ScreenedGround, line: LineString | None, letter: str) -> bytes:
    """Relief of the points' heights with the labelled ones, the outline and the section's line, as PNG."""
    width, height = (mm / _INCH_MM for mm in _MAP_MM)
    sheet = Sheet(width, height, _DPI)
    axes = sheet.axes(0.3, 0.2, width - 0.35, height - 0.25, "map")
    bounds = surroundings(zone)
    heights, grid = _heights(ground, bounds)
    shade = hillshade(heights, grid.cell)
    known = np.isfinite(shade)
    image = np.full((*shade.shape, 3), 255, dtype=np.uint8)
    image[known] = np.clip(110 + 0.55 * shade[known], 0, 250).astype(np.uint8)[:, np.newaxis]
    draw_image(axes, image, grid, "nearest")
    on_paper = 72.0 * (width - 0.35) / (bounds[2] - bounds[0])
    dot = float(np.clip(_DOT_SHARE * on_paper * _spacing(ground, bounds), _LEAST_DOT, _MOST_DOT))
    for label in (1, 2):
        chosen = np.flatnonzero(ground.labels == label)
        chosen = chosen[:: max(1, -(-len(chosen) // _MOST_DOTS))]
        axes.plot(
            ground.points[chosen, 0], ground.points[chosen, 1], ".", color=_COLOURS[label], ms=dot, mew=0, alpha=0.7,
            zorder=2,
        )  # fmt: skip
    for ring in outlines(np.array([zone], dtype=object), bounds, _CELL_M / 10):
        axes.plot(*np.asarray(ring).T[:2], color=INK, lw=1.1, zorder=3)
    if line is not None:
        x, y = np.array(line.coords).T[:2]
        axes.plot(x, y, color=INK, lw=0.9, ls=(0, (6, 2, 1, 2)), zorder=4)
        for at, name in ((0, letter), (-1, f"{letter}′")):
            axes.text(
                x[at], y[at], name, fontproperties=fonts(SMALL, "bold"), ha="center", va="center", zorder=5,
                clip_on=True,
            )  # fmt: skip
    _same_scale(axes, bounds, (width - 0.35) / (height - 0.25))
    west, east = axes.get_xlim()
    inches = (width - 0.35) / (east - west)
    south, north = axes.get_ylim()
    tall = max(1, round(1000 * (north - south) / (east - west)))
    draw_coordinates(axes, Grid(west, north, (east - west) / 1000, tall, 1000), inches)
    axes.set(xlim=(west, east), ylim=(south, north))
    stream = io.BytesIO()
    sheet.figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": "SlopeWatch"}, pil_kwargs=PNG_OPTIONS)
    return stream.getvalue()


def _same_scale(axes: Axes, bounds: tuple[float, float, float, float], aspect: float) -> None:
    """A metre is as long on the map in both directions."""
    west, south, east, north = bounds
    wide = max(east - west, (north - south) * aspect)
    tall = wide / aspect
    x, y = (west + east) / 2, (south + north) / 2
    axes.set(xlim=(x - wide / 2, x + wide / 2), ylim=(y - tall / 2, y + tall / 2))


def _section(zone: BaseGeometry, ground: ScreenedGround, along_it: tuple[LineString, float], letter: str) -> bytes:
    """Points within a band of the line by distance along it and height over the surface of the ground around."""
    line, band = along_it
    width, height = (mm / _INCH_MM for mm in _SECTION_MM)
    sheet = Sheet(width, height, _DPI)
    axes = sheet.axes(0.62, 0.4, width - 0.75, height - 0.48)
    start, end = (np.array(line.coords[at][:2]) for at in (0, -1))
    ahead = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
    away = ground.points[:, :2] - start
    along, across = away @ ahead, away @ np.array([-ahead[1], ahead[0]])
    rest = ground.over_trend()
    near = (np.abs(across) <= band) & (along >= 0) & (along <= line.length) & np.isfinite(rest)
    dot = 2.2 if np.count_nonzero(near) > _SECTION_POINTS else 3.6
    for label, colour in enumerate(_COLOURS):
        chosen = np.flatnonzero(near & (ground.labels == label))
        chosen = chosen[:: max(1, -(-len(chosen) // _MOST_DOTS))]
        axes.plot(along[chosen], rest[chosen], ".", color=colour, ms=dot, mew=0)
    axes.axhline(0.0, color="#57606a", lw=0.6)
    met = [line.project(Point(at)) for at in get_coordinates(line.intersection(zone))]
    if met:
        axes.axvspan(min(met), max(met), color="#000000", alpha=0.06, lw=0, zorder=0)
    axes.set_xlim(0, line.length)
    finish(axes, "distance along the line (m)", "over the trend (m)")
    for x, name, side in ((0.008, letter, "left"), (0.992, f"{letter}′", "right")):
        axes.text(
            x, 0.94, name, transform=axes.transAxes, ha=side, va="top", fontproperties=fonts(9, "bold"), color=INK
        )
    if not near.any():
        axes.text(
            0.5, 0.5, say_in_picture("not measured"), transform=axes.transAxes, ha="center", fontproperties=fonts(9)
        )
    stream = io.BytesIO()
    sheet.figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": "SlopeWatch"}, pil_kwargs=PNG_OPTIONS)
    return stream.getvalue()
