"""The picture of a planned flight: its lines over the relief, and the expected ground density and level beneath."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes

from ..core.arrays import Float
from ..core.staged_outputs import atomic_output
from ..flight.plan import Plan
from ..grid.grid import Grid
from .map_parts import Sheet, draw_colour_bar, draw_coordinates, draw_image, draw_north, draw_scale_bar, round_length
from .palette import sequential_steps
from .picture_words import fonts, say
from .relief import shaded_relief

_WIDTH, _MARGIN, _HEAD, _FOOT = 5.2, 0.75, 0.55, 0.9  # inches of a map, and around it
_TALLEST = 6.0
_ARROW_SHARE = 0.5


def write_plan_picture(path: Path, plan: Plan, title: str) -> None:
    """Write three maps side by side: lines over the shaded relief, ground returns a m², level of detection."""
    west, south, east, north = _bounds(plan)
    inches = min(_WIDTH / (east - west), _TALLEST / (north - south))
    wide, tall = inches * (east - west), inches * (north - south)
    sheet = Sheet(3 * (wide + _MARGIN) + 0.3, tall + _HEAD + _FOOT + 0.3, dpi=110)
    sheet.text(sheet.width / 2, sheet.height - 0.3, title, 12.0, ha="center")
    frame = Grid(west, north, 1.0, math.ceil(north - south), math.ceil(east - west))
    ground, level = plan.expected.ground, plan.expected.level
    for number, (name, values, unit) in enumerate(
        (
            ("Lines over the relief", None, ""),
            ("Expected ground returns a m²", ground, "/m²"),
            ("Expected level of detection", level, "m"),
        )
    ):
        left = _MARGIN + number * (wide + _MARGIN)
        axes = sheet.axes(left, _FOOT, wide, tall, f"map {number}")
        terrain = plan.terrain
        relief = np.clip(np.rint(shaded_relief(terrain.heights, terrain.grid.cell)), 0, 255).astype(np.uint8)
        relief[~np.isfinite(terrain.heights)] = 255
        draw_image(axes, relief, terrain.grid)
        draw_coordinates(axes, frame, inches)
        sheet.text(left + wide / 2, _FOOT + tall + 0.12, say(name), 9.5, ha="center")
        if values is not None:
            limits = _limits(values)
            draw_image(axes, _coloured(values, limits), plan.expected.grid, "nearest")
            _bar(sheet, left, wide, limits, unit)
        _outline(axes, plan)
        for line in plan.lines:
            axes.plot(line.xyz[:, 0], line.xyz[:, 1], color="#d96b1e", linewidth=1.3, zorder=5)
            if values is None:
                _arrow(axes, line.xyz, line.number)
        axes.set(xlim=(west, east), ylim=(south, north))
    draw_north(sheet, _MARGIN + 0.1, 0.12)
    draw_scale_bar(sheet, _MARGIN + 0.5, 0.25, min(1.6, wide - 0.6), inches)
    with atomic_output(path) as partial:
        sheet.figure.savefig(partial, format="png", metadata={"Software": None})


def _bounds(plan: Plan) -> tuple[float, float, float, float]:
    places = np.concatenate([line.xyz[:, :2] for line in plan.lines] + [shapely.get_coordinates(plan.region)])
    (west, south), (east, north) = places.min(axis=0), places.max(axis=0)
    edge = 0.04 * max(east - west, north - south)
    return float(west - edge), float(south - edge), float(east + edge), float(north + edge)


def _limits(values: Float) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    high = float(np.percentile(known, 98))
    return 0.0, max(high, 1e-6)


def _coloured(values: Float, limits: tuple[float, float]) -> np.ndarray:
    share = np.clip((np.nan_to_num(values) - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0)
    rgba = np.zeros((*values.shape, 4), dtype=np.uint8)
    rgba[..., :3] = np.array(sequential_steps(256), dtype=np.uint8)[np.rint(255 * share).astype(int)]
    rgba[..., 3] = np.where(np.isfinite(values), 255, 0)
    return rgba


def _bar(sheet: Sheet, left: float, wide: float, limits: tuple[float, float], unit: str) -> None:
    ramp = _coloured(np.linspace(*limits, 256)[None], limits)[0, :, :3]
    step = round_length(limits[1] / 2.0)
    ticks = [0.0, *(k * step for k in range(1, int(limits[1] / step + 1e-9) + 1))]
    labels = [f"{tick:g}" for tick in ticks]
    labels[-1] += f" {unit}"
    colours = np.asarray(ramp[: max(2, round(256 * ticks[-1] / limits[1]))])
    draw_colour_bar(sheet, (left, 0.38, wide, 0.14), colours, ticks, labels)


def _outline(axes: Axes, plan: Plan) -> None:
    for part in shapely.get_parts(plan.region):
        axes.plot(*np.array(part.exterior.coords).T, color="black", linewidth=1.0, linestyle="--", zorder=4)


def _arrow(axes: Axes, xyz: Float, number: int) -> None:
    start, end = xyz[0, :2], xyz[-1, :2]
    middle, way = start + _ARROW_SHARE * (end - start), (end - start) / float(np.hypot(*(end - start)))
    axes.annotate(
        "",
        xy=tuple(middle + 2 * way),
        xytext=tuple(middle),
        arrowprops={"arrowstyle": "-|>", "color": "#d96b1e", "lw": 1.3},
        zorder=6,
    )
    axes.annotate(
        str(number), (float(start[0]), float(start[1])), fontproperties=fonts(8), ha="center", va="center", zorder=7,
        bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
    )  # fmt: skip
