"""Pictures of scenes: shaded relief as surveyed, the labels over it, and the hard negatives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ...engine.gridding import cell_index, snapped_grid
from ...engine.outputs import atomic_output
from .negatives import Negative
from .scenes import SUBSIDENCE, UPLIFT, SimulatedScene

Float = NDArray[np.float64]
LABEL_COLOURS = {UPLIFT: (0x2A, 0x6B, 0xAE), SUBSIDENCE: (0xB4, 0x36, 0x28)}
"""The project's colours of raised and lowered ground."""


def shade(scene: SimulatedScene, cell: float | None = None) -> tuple[Float, NDArray[np.int64], NDArray[np.int64]]:
    """Shaded relief of a scene seen along the normal of its mean plane, up-slope upwards.

    Args:
        cell: side of a pixel, m; by default such that about three points fall in one.

    Returns:
        Grey (rows, columns) of 0 to 1, NaN where there are no points; the label that most points of the pixel have;
        the hard negative that most have.
    """
    cell = cell or max(0.1, math.sqrt(3.0 * scene.area / max(1, len(scene))))
    plane = scene.to_plane(scene.xyz)
    low, high = plane.min(axis=0), plane.max(axis=0)
    grid = snapped_grid((low[0], low[1], high[0], high[1]), cell)
    index = cell_index(plane, grid)
    cells = grid.rows * grid.columns
    count = np.bincount(index, minlength=cells)
    with np.errstate(invalid="ignore"):
        height = (np.bincount(index, weights=plane[:, 2], minlength=cells) / count).reshape(grid.shape)
    empty = np.isnan(height)
    nearest = distance_transform_edt(empty, return_distances=False, return_indices=True)
    filled = height[tuple(nearest)]
    down, right = np.gradient(filled, cell)
    # Light from the upper left, 35 degrees above the slope.
    light = np.array([-0.58, 0.58, 0.57])
    grey = (light[2] - right * light[0] + down * light[1]) / np.sqrt(1 + right**2 + down**2)
    grey = np.clip(0.15 + 0.85 * grey, 0.0, 1.0)
    far = distance_transform_edt(empty) > 2
    grey[far] = np.nan
    return (
        grey,
        _most(index, scene.label, cells).reshape(grid.shape),
        _most(index, scene.negative, cells).reshape(grid.shape),
    )


def _rgb(label: int) -> tuple[float, float, float]:
    red, green, blue = LABEL_COLOURS[label]
    return red / 255, green / 255, blue / 255


def _most(index: NDArray[np.int64], values: NDArray[np.uint8], cells: int) -> NDArray[np.int64]:
    """The value that most points of each cell have; 0 where there are none."""
    kinds = int(values.max()) + 1
    votes = np.bincount(index * kinds + values, minlength=cells * kinds).reshape(cells, kinds)
    return votes.argmax(axis=1)


def draw_scenes(scenes: Sequence[SimulatedScene], path: Path, *, negatives: bool = True, width: float = 14.0) -> None:
    """A PNG ``width`` inches wide with a row for each scene: relief, labels over it and, if asked for, hard negatives.

    Raises:
        InputError: the folder of ``path`` does not exist or cannot be written.
    """
    columns = 3 if negatives else 2
    shaded = [shade(scene) for scene in scenes]
    ratios = [grey.shape[0] / grey.shape[1] for grey, _, _ in shaded]
    figure = Figure(figsize=(width, width / columns * sum(ratios) + 0.3 * len(scenes) + 0.6), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(scenes), columns, height_ratios=ratios))
    seen: set[int] = set()
    for row, scene, (grey, label, negative) in zip(axes, scenes, shaded):
        relief = np.ma.masked_invalid(grey)
        for axis in row:
            axis.imshow(relief, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
            axis.set_axis_off()
        row[0].set_title(
            f"{scene.spec.kind} {scene.spec.seed}: {scene.area:,.0f} m², {len(scene) / scene.area:.0f} points a m², "
            f"dip {scene.dip:.0f}°",
            fontsize=8,
        )
        overlay = np.zeros((*label.shape, 4))
        for value in LABEL_COLOURS:
            overlay[label == value] = (*_rgb(value), 0.55)
        row[1].imshow(overlay, interpolation="nearest")
        row[1].set_title("{:.1%} background, {:.1%} uplift, {:.1%} subsidence".format(*scene.shares), fontsize=8)
        if negatives:
            marks = np.zeros((*negative.shape, 4))
            for kind in set(np.unique(negative).tolist()) - {0}:
                marks[negative == kind] = (*colormaps["tab20"](kind)[:3], 0.75)
                seen.add(kind)
            row[2].imshow(marks, interpolation="nearest")
    handles = [Patch(color=_rgb(UPLIFT), label="uplift")]
    handles.append(Patch(color=_rgb(SUBSIDENCE), label="subsidence"))
    handles += [
        Patch(color=colormaps["tab20"](kind), label=Negative(kind).name.lower().replace("_", " "))
        for kind in sorted(seen)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=8, fontsize=8)
    with atomic_output(path) as partial:
        FigureCanvasAgg(figure).print_png(str(partial))
