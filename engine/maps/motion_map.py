"""The map of motion along the surface: arrows with the ellipses of their errors, zones, and where nothing is known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import geopandas as gpd
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrow
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from ..core.arrays import Bool, Float
from ..grid.grid import Grid
from .displacement_styles import ELLIPSE_ERRORS
from .figure import DPI, Layout, plan_layout
from .map_parts import (
    BODY,
    INK,
    SMALL,
    Sheet,
    draw_coordinates,
    draw_image,
    draw_key,
    draw_north,
    draw_scale_bar,
    round_length,
    wrap,
)
from .picture_words import fonts, say

VECTOR, ZONE = "#b31818", "#542788"
"""Colours of single vectors and of zones, as in QGIS."""
_UNKNOWN = (0x6E, 0x73, 0x79, 150)
_TITLE = 13.0
_LEFT, _RIGHT, _COLUMN = 0.5, 0.4, 2.6  # as of ``plan_layout``, inches
_SHAFT, _ZONE_SHAFT = 0.016, 0.034  # inches
_LEGEND_INCHES = 1.5  # of the longest reference arrow
_LINES_KEPT = 3


@dataclass(frozen=True)
class Arrows:
    """Motions at places (n, 2): ``motion`` (n, 2) east and north, metres, and one standard error's ellipse (n, 3): half
    its axes in metres, the larger first, and the azimuth of the larger one in degrees.
    """

    places: Float
    motion: Float
    ellipse: Float

    @classmethod
    def of(cls, frame: gpd.GeoDataFrame) -> Arrows:
        """From a layer of vectors or zones, as ``displacement.gpkg`` has them."""
        columns = [frame[list(names)].to_numpy(dtype=np.float64) for names in _COLUMNS]
        places = shapely.get_coordinates(shapely.centroid(np.asarray(frame.geometry)))
        return cls(places.reshape(-1, 2), *columns)


_COLUMNS = (("east_m", "north_m"), ("err_major_m", "err_minor_m", "err_azimuth_deg"))


@dataclass(frozen=True)
class MotionMap:
    """What the map shows.

    Attributes:
        grid: of the windows; ``known`` and ``unseen`` (rows, columns) are where a motion or its absence can be seen,
            and where there is a window that shows neither.
        backdrop: picture (rows, columns, 3) of the ground and its grid; None: white.
        vectors: the significant ones that are drawn; ``zones`` the layer of zones.
        magnification: how many times as long as in truth arrows are drawn.
    """

    grid: Grid
    known: Bool
    unseen: Bool
    backdrop: tuple[NDArray[np.uint8], Grid] | None
    vectors: Arrows
    zones: gpd.GeoDataFrame
    magnification: float


def motion_figure(shown: MotionMap, epochs: tuple[str, str]) -> Figure:
    """The map with legend, reference arrow, scale and north; ``epochs`` are the surveys' names."""
    west, south, east, north = shown.grid.bounds
    layout = plan_layout(east - west, north - south, 0.0)
    sheet = Sheet(layout.width, layout.height, DPI)
    dates = say("{0} to {1}").format(*epochs) if all(epochs) else ""
    title = ", ".join(part for part in (say("Motion along the surface"), dates) if part)
    measure = partial(sheet.text_width, size=_TITLE, weight="bold")
    lines = wrap(title, layout.width - _LEFT - _RIGHT, measure)[:_LINES_KEPT]
    layout = plan_layout(east - west, north - south, 0.3 + 0.25 * len(lines))
    sheet.resize(layout.width, layout.height)
    for number, line in enumerate(lines):
        sheet.text(_LEFT, layout.height - 0.3 - 0.25 * number, line, _TITLE, weight="bold")
    axes = sheet.axes(layout.map_left, layout.map_bottom, layout.map_width, layout.map_height, "map")
    if shown.backdrop is not None:
        draw_image(axes, *shown.backdrop)
    veil = np.zeros((*shown.grid.shape, 4), dtype=np.uint8)
    veil[shown.unseen] = _UNKNOWN
    west, south, east, north = shown.grid.bounds
    axes.imshow(veil, extent=(west, east, south, north), interpolation="nearest", aspect="auto", zorder=2)
    inches = layout.map_width / (east - west)
    draw_coordinates(axes, shown.grid, inches)
    _draw_arrows(axes, shown.vectors, shown.magnification, VECTOR, _SHAFT)
    _draw_zones(axes, shown, inches)
    _draw_legend(sheet, layout, shown, inches)
    return sheet.figure


def _draw_arrows(axes: Axes, arrows: Arrows, magnification: float, colour: str, shaft: float) -> None:
    if not len(arrows.places):
        return
    step = magnification * arrows.motion
    tips = arrows.places + step
    size = 2 * ELLIPSE_ERRORS * magnification * arrows.ellipse[:, :2]
    ellipses = EllipseCollection(
        size[:, 0], size[:, 1], 90.0 - arrows.ellipse[:, 2], units="xy", offsets=tips,
        offset_transform=axes.transData, facecolors=f"{colour}2d", edgecolors=f"{colour}b0", linewidths=0.5, zorder=4,
    )  # fmt: skip
    axes.add_collection(ellipses, autolim=False)
    axes.quiver(
        *arrows.places.T, *step.T, angles="xy", scale_units="xy", scale=1.0, units="inches", width=shaft,
        headwidth=4.5, headlength=5.0, headaxislength=4.5, minlength=0.5, color=colour, zorder=5,
    )  # fmt: skip


def _draw_zones(axes: Axes, shown: MotionMap, inches: float) -> None:
    zones = shown.zones
    if not len(zones):
        return
    parts = shapely.get_parts(np.asarray(zones.geometry))
    rings = [shapely.get_coordinates(ring) for part in parts for ring in (part.exterior, *part.interiors)]
    axes.add_collection(LineCollection(rings, colors="white", linewidths=2.4, alpha=0.7, zorder=3), autolim=False)
    axes.add_collection(LineCollection(rings, colors=ZONE, linewidths=1.3, zorder=3.5), autolim=False)
    arrows = Arrows.of(zones)
    _draw_arrows(axes, arrows, shown.magnification, ZONE, _ZONE_SHAFT)
    back = -arrows.motion / np.maximum(np.linalg.norm(arrows.motion, axis=1, keepdims=True), 1e-12)
    for name, (x, y) in zip(zones["zone_id"], arrows.places + 0.16 / inches * back, strict=True):
        axes.text(
            x, y, name, fontproperties=fonts(SMALL + 1, "bold"), color=ZONE, ha="center", va="center", zorder=6,
            path_effects=[withStroke(linewidth=2.2, foreground="white")], clip_on=True,
        )  # fmt: skip


def _draw_legend(sheet: Sheet, layout: Layout, shown: MotionMap, inches: float) -> None:
    if layout.at_the_side:
        x, top = layout.width - _RIGHT - _COLUMN + 0.35, layout.map_bottom + layout.map_height
        draw_north(sheet, x + 0.12, top - 0.5)
        draw_scale_bar(sheet, x, top - 1.0, 1.8, inches)
        arrow, keys = (x, top - 1.55), (x, top - 2.45)
    else:
        draw_north(sheet, _LEFT + 0.12, 0.4)
        draw_scale_bar(sheet, _LEFT + 0.6, 0.55, 2.0, inches)
        arrow, keys = (_LEFT + 3.0, 0.85), (_LEFT + 5.6, 0.88)
    if len(shown.vectors.places) or len(shown.zones):
        _draw_reference(sheet, *arrow, inches, shown.magnification)
    opacity = _UNKNOWN[3] / 255
    grey = "#{:02x}{:02x}{:02x}".format(*(round(255 - opacity * (255 - part)) for part in _UNKNOWN[:3]))
    rows = [("none", INK, "Motion or its absence can be seen"), (grey, "none", "Nothing known of motion here")]
    if len(shown.zones):
        rows.insert(0, ("none", ZONE, "Zone that moves as one, with its vector"))
    for number, (face, edge, words) in enumerate(rows):
        draw_key(sheet, keys[0], keys[1] - 0.26 * number, [say(words)], face=face, edge=edge)


def _draw_reference(sheet: Sheet, x: float, y: float, inches: float, magnification: float) -> None:
    """An arrow of a round length with its name, and what arrows and ellipses are."""
    length = round_length(_LEGEND_INCHES / (inches * magnification))
    size = length * inches * magnification
    head = min(0.09, 0.6 * size)
    sheet.shape(
        FancyArrow(
            0, 0, size, 0, width=_SHAFT, head_width=0.075, head_length=head, length_includes_head=True, color=VECTOR,
        ),
        x, y,
    )  # fmt: skip
    named = f"{length:g} m" if length >= 0.1 else f"{1000 * length:g} mm"
    sheet.text(x + size + 0.1, y, named, BODY, weight="bold")
    sheet.text(x, y - 0.2, say("Arrows {0} times as long as the motion,").format(f"{magnification:g}"))
    sheet.text(x, y - 0.36, say("ellipses of two standard errors"))
