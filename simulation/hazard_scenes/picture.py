"""Pictures of scenes: shaded relief as surveyed, the labels over it, and the hard negatives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import distance_transform_edt

from ...engine.core.arrays import Float
from ...engine.core.staged_outputs import atomic_output
from ...engine.grid.grid import cell_index, snapped_grid
from ...engine.statistics.nearest_known import nearest_known
from .negatives import Negative
from .scenes import SUBSIDENCE, UPLIFT, SimulatedScene

LABEL_COLOURS = {UPLIFT: (0x2A, 0x6B, 0xAE), SUBSIDENCE: (0xB4, 0x36, 0x28)}
"""The project's colours of raised and lowered ground."""
NEGATIVE_COLOURS: dict[int, tuple[int, int, int]] = {
    Negative.DRAIN: (0x1B, 0x9E, 0x9E),
    Negative.DITCH: (0x66, 0xC2, 0xA5),
    Negative.BEAM: (0xE6, 0xAB, 0x02),
    Negative.BENCH_EDGE: (0x4D, 0xAF, 0x4A),
    Negative.RILL: (0xC0, 0x7A, 0x3A),
    Negative.GULLY: (0x8C, 0x4B, 0x10),
    Negative.STEP: (0xFF, 0x7F, 0x00),
    Negative.BOULDER: (0x6A, 0x3D, 0x9A),
    Negative.SPOIL: (0xB0, 0x90, 0xD0),
    Negative.STUMP: (0x4A, 0x2A, 0x05),
    Negative.SEAM: (0xF7, 0x81, 0xBF),
    Negative.RESIDUE: (0xE7, 0x29, 0x8A),
    Negative.STAIRS: (0x00, 0xBC, 0xD4),
    Negative.PIPE: (0x1A, 0x1A, 0x1A),
    Negative.TERRACETTE: (0x9A, 0xD0, 0x60),
    Negative.FACET: (0xBC, 0xBD, 0x22),
}
LABEL_OPACITY, NEGATIVE_OPACITY = 0.55, 0.75


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
    filled = height[nearest_known(~empty)]
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


def _rgb(colour: tuple[int, int, int]) -> tuple[float, float, float]:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255


def _most(index: NDArray[np.int64], values: NDArray[np.uint8], cells: int) -> NDArray[np.int64]:
    """The value that most points of each cell have; 0 where there are none."""
    kinds = int(values.max()) + 1
    votes = np.bincount(index * kinds + values, minlength=cells * kinds).reshape(cells, kinds)
    return votes.argmax(axis=1)


@dataclass(frozen=True)
class Panels:
    """What is drawn of a scene: ``grey``, ``label`` and ``negative`` (rows, columns) as ``shade`` gives them."""

    title: str
    shares: tuple[float, float, float]
    grey: Float
    label: NDArray[np.int64]
    negative: NDArray[np.int64]

    @property
    def ratio(self) -> float:
        """Height over width."""
        return self.grey.shape[0] / self.grey.shape[1]


def panels(scene: SimulatedScene, cell: float | None = None) -> Panels:
    """What is drawn of a scene, in pixels of ``cell`` m (see ``shade``); much smaller than the scene."""
    title = (
        f"{scene.spec.kind} {scene.spec.seed}: {scene.area:,.0f} m², {len(scene) / scene.area:.0f} points/m², "
        f"dip {scene.dip:.0f}°"
    )
    return Panels(title, scene.shares, *shade(scene, cell))


def draw_panels(
    scenes: Sequence[Panels],
    path: Path,
    *,
    negatives: bool = True,
    across: int = 1,
    width: float = 14.0,
    small_file: bool = False,
) -> None:
    """A PNG ``width`` inches wide, ``across`` scenes in a row: relief, labels over it and, if asked for, hard
    negatives.

    Where several scenes share a row the bare relief is left out.

    Args:
        small_file: with a palette of the colours that the picture is made of, which takes a third of the bytes.

    Raises:
        InputError: the folder of ``path`` does not exist or cannot be written.
    """
    shown = [name for name, wanted in (("relief", across == 1), ("labels", True), ("negatives", negatives)) if wanted]
    columns, rows = across * len(shown), -(-len(scenes) // across)
    ratios = [max(s.ratio for s in scenes[across * r : across * (r + 1)]) for r in range(rows)]
    figure = Figure(figsize=(width, width / columns * sum(ratios) + 0.35 * rows + 0.7), layout="constrained", dpi=100.0)
    axes = figure.subplots(rows, columns, height_ratios=ratios, squeeze=False)
    for axis in axes.ravel():
        axis.set_axis_off()
    small = 8 if across == 1 else 6.5
    for number, scene in enumerate(scenes):
        row, first = number // across, number % across * len(shown)
        mine = dict(zip(shown, axes[row, first : first + len(shown)]))
        for axis in mine.values():
            axis.imshow(np.ma.masked_invalid(scene.grey), cmap="gray", vmin=0, vmax=1, interpolation="antialiased")
        mine["labels"].imshow(_overlay(scene.label, LABEL_COLOURS, LABEL_OPACITY), interpolation="antialiased")
        next(iter(mine.values())).set_title(scene.title, fontsize=small)
        second = mine["labels"] if across == 1 else list(mine.values())[-1]
        words = "{:.1%} background, {:.1%} uplift, {:.1%} subsidence" if across == 1 else "up {1:.1%}, down {2:.1%}"
        if second is not mine[shown[0]]:
            second.set_title(words.format(*scene.shares), fontsize=small)
        if negatives:
            overlay = _overlay(scene.negative, NEGATIVE_COLOURS, NEGATIVE_OPACITY)
            mine["negatives"].imshow(overlay, interpolation="antialiased")
    present = {int(kind) for scene in scenes for kind in np.unique(scene.negative)} if negatives else set()
    named = [("uplift", LABEL_COLOURS[UPLIFT]), ("subsidence", LABEL_COLOURS[SUBSIDENCE])]
    named += [
        (Negative(k).name.lower().replace("_", " "), colour) for k, colour in NEGATIVE_COLOURS.items() if k in present
    ]
    handles = [Patch(color=_rgb(colour), label=name) for name, colour in named]
    figure.legend(handles=handles, loc="outside lower center", ncols=9, fontsize=8)
    with atomic_output(path) as partial:
        drawn = FigureCanvasAgg(figure)
        if not small_file:
            drawn.print_png(str(partial))
            return
        drawn.draw()
        picture = Image.fromarray(np.asarray(drawn.buffer_rgba())).convert("RGB")
        picture.quantize(palette=_palette(), dither=Image.Dither.NONE).save(partial, "PNG", optimize=True)


def _overlay(values: NDArray[np.int64], colours: Mapping[int, tuple[int, int, int]], opacity: float) -> Float:
    """(rows, columns, 4) colours of the values that have one, transparent elsewhere."""
    overlay = np.zeros((*values.shape, 4))
    for value, colour in colours.items():
        overlay[values == value] = (*_rgb(colour), opacity)
    return overlay


def _palette() -> Image.Image:
    """An image whose palette has 12 greys, each bare and under every colour of the overlays, and those colours."""
    greys = np.linspace(0, 255, 12)
    tints = [(colour, LABEL_OPACITY) for colour in LABEL_COLOURS.values()]
    tints += [(colour, NEGATIVE_OPACITY) for colour in NEGATIVE_COLOURS.values()]
    colours = [(grey, grey, grey) for grey in greys] + [colour for colour, _ in tints]
    colours += [
        tuple(opacity * band + (1 - opacity) * grey for band in colour) for colour, opacity in tints for grey in greys
    ]
    palette = Image.new("P", (1, 1))
    palette.putpalette([round(band) for colour in colours for band in colour])
    return palette
