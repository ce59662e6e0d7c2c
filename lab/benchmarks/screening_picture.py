"""Pictures of a screened slope: shaded ground seen along the slope's normal, zones shown, outlines of the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import griddata
from scipy.spatial import cKDTree

from ...engine.geometry.hazard_shapes import outline
from ...engine.maps.relief import shaded_relief
from ...simulation.hazard_scenes.known_hazards import KnownHazards

if TYPE_CHECKING:
    from .real_screening import RealGround, Zone

PIXEL = 0.2
GAP = 1.0
"""Ground farther than this (m) from any point is left white."""
NAMED = 15
"""Zones, the largest ones, whose number and height are written."""
COLOURS = {1: "#2A6BAE", 2: "#B43628"}
"""As everywhere: raised ground is cold, lowered ground is warm."""


def draw(
    path: Path,
    ground: RealGround,
    probabilities: NDArray[np.floating],
    zones: Sequence[Zone],
    truth: KnownHazards | None = None,
) -> None:
    """Write a PNG: points shown as uplift blue, as subsidence red, the largest zones, outlines of hazards put in."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    matrix, flat = ground.matrix, ground.flat
    low, high = flat[:, :2].min(axis=0), flat[:, :2].max(axis=0)
    u, w = np.meshgrid(np.arange(low[0], high[0], PIXEL), np.arange(high[1], low[1], -PIXEL))
    height = griddata(flat[:, :2], flat[:, 2], (u, w))
    far = cKDTree(flat[:, :2]).query(np.column_stack([u.ravel(), w.ravel()]))[0].reshape(u.shape) > GAP
    height[far] = np.nan
    picture = shaded_relief(height, PIXEL) / 255.0
    picture[~np.isfinite(height)] = 1.0

    figure = Figure(figsize=(9, 9 * float(high[1] - low[1]) / float(high[0] - low[0]) + 0.6), dpi=100)
    axes = figure.add_subplot()
    axes.imshow(picture, extent=(low[0], high[0], low[1], high[1]))
    predicted = probabilities.argmax(axis=1)
    axes.scatter(flat[:, 0], flat[:, 1], s=1.0, c="#555555", linewidths=0)
    for kind, colour in COLOURS.items():
        mine = predicted == kind
        axes.scatter(flat[mine, 0], flat[mine, 1], s=5, c=colour, linewidths=0)
    for number, zone in enumerate(zones[:NAMED], 1):
        axes.annotate(
            f"{number}: {zone.height:+.2f} m", zone.flat, fontsize=7, ha="center",
            bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": COLOURS[zone.kind], "alpha": 0.8},
        )  # fmt: skip
    if truth is not None:
        for hazard in truth.shapes:
            corners = outline(hazard)
            corners = np.vstack([corners, corners[:1]])
            corners = np.column_stack([corners, np.zeros(len(corners)), np.ones(len(corners))])
            place = corners @ np.linalg.inv(truth.matrix).T @ matrix.T
            axes.plot(place[:, 0], place[:, 1], c=COLOURS[1 if hazard.height > 0 else 2], lw=2)
            axes.plot(place[:, 0], place[:, 1], c="black", lw=0.6)
    axes.set_aspect("equal")
    axes.set_xlabel("along the slope (m)")
    axes.set_ylabel("up the slope (m)")
    axes.set_title(f"{ground.name}: uplift blue, subsidence red" + (", outlines put in" if truth else ", untouched"))
    FigureCanvasAgg(figure).print_png(str(path))
