"""Legends of maps."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.patches import Rectangle

from .furniture import BODY, INK, SMALL, Sheet
from .heatmap_image import Heatmap
from .palette import diverging_colours, veiled


def draw_legend(sheet: Sheet, box: tuple[float, float, float, float], heatmap: Heatmap, *, vertical: bool) -> None:
    """Colour bar in ``box`` (x, y, width, height), centred on zero; grey where change is below the median level."""
    limit, level, backdrop, words = heatmap.limit, heatmap.level, heatmap.backdrop, heatmap.words
    x, y, width, height = box
    axes = sheet.axes(*box)
    axes.set_label("legend")
    values = np.linspace(-limit, limit, 401)
    # as half-transparent as in the map, and never so faint that the legend says nothing
    colours = backdrop + max(heatmap.opacity, 0.35) * (diverging_colours(values, limit).astype(np.float64) - backdrop)
    if math.isfinite(level):
        colours[np.abs(values) < level] = veiled(backdrop, heatmap.opacity)
    strip = np.rint(colours).astype(np.uint8)
    span = (-limit, limit)
    if vertical:
        axes.imshow(strip[:, np.newaxis], extent=(0, 1, *span), origin="lower", aspect="auto")
    else:
        axes.imshow(strip[np.newaxis], extent=(*span, 0, 1), aspect="auto")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_linewidth(0.6)
        spine.set_color(INK)
    for share in (-1.0, -0.5, 0.0, 0.5, 1.0):
        value = share * limit if words.signed else abs(share * limit)
        label = f"{value:{'+' if words.signed else ''}.4g}".replace("-", "−") if share else "0"
        if vertical:
            sheet.text(x + width + 0.08, y + height * (share + 1) / 2, label)
        else:
            sheet.text(x + width * (share + 1) / 2, y - 0.12, label, ha="center")
    if vertical:
        sheet.text(x, y + height + 0.36, words.legend, BODY)
        sheet.text(x, y + height + 0.15, words.high, SMALL)
        sheet.text(x, y - 0.15, words.low, SMALL)
    else:
        sheet.text(x + width / 2, y + height + 0.14, words.legend, BODY, ha="center")
        sheet.text(x, y + height + 0.14, words.low, SMALL)
        sheet.text(x + width, y + height + 0.14, words.high, SMALL, ha="right")


def draw_keys(sheet: Sheet, x: float, y: float, heatmap: Heatmap, *, outlines: bool) -> None:
    """What the grey and the outlines mean, one below the other from ``y`` (centre of the first) down."""
    grey = veiled(heatmap.backdrop, heatmap.opacity) / 255.0
    axes = sheet.canvas(x, y - 0.07, 0.24, 0.14)
    axes.add_patch(Rectangle((0, 0), 0.24, 0.14, facecolor=(grey, grey, grey), edgecolor="none", clip_on=False))
    sheet.text(x + 0.32, y + 0.075, heatmap.words.veil[0])
    sheet.text(x + 0.32, y - 0.075, heatmap.words.veil[1])
    if outlines:
        axes = sheet.canvas(x, y - 0.41, 0.24, 0.14)
        axes.add_patch(Rectangle((0, 0), 0.24, 0.14, facecolor="none", edgecolor=INK, lw=1.0, clip_on=False))
        sheet.text(x + 0.32, y - 0.34, heatmap.words.outline)
