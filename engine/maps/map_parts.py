"""Parts that all maps share: a sheet in inches, the picture north up, scale bar, north arrow, colour bar, keys."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from ..grid.grid import Grid
from .heatmap_image import Heatmap
from .palette import diverging_colours, veiled
from .picture_words import fonts, pieces, say

INK = "#222222"
BODY, SMALL = 9.0, 7.5  # points
# of a PNG: measured, the default of 6 takes two to three times as long and saves a tenth, of shaded relief nothing
PNG_OPTIONS = {"compress_level": 3}


class Sheet:
    """A figure addressed in inches from its lower left, on a canvas of its own: no global state of matplotlib."""

    def __init__(self, width: float, height: float, dpi: float = 100.0) -> None:
        self.figure = Figure(dpi=dpi, facecolor="white")
        self.canvas = FigureCanvasAgg(self.figure)
        self.resize(width, height)

    def resize(self, width: float, height: float) -> None:
        """Give the sheet another size; what stands on it keeps its share of the sheet, not its place in inches."""
        self.width, self.height = width, height
        self.figure.set_size_inches(width, height)

    def text(
        self, x: float, y: float, text: str, size: float = SMALL, *, weight: str = "normal", ha: str = "left"
    ) -> None:
        """Write one line whose vertical middle is at ``y``."""
        place, font = (x / self.width, y / self.height), fonts(size, weight)
        self.figure.text(*place, text, fontproperties=font, color=INK, ha=ha, va="center", parse_math=False)

    def text_width(self, text: str, size: float, weight: str = "normal") -> float:
        """Inches that a line of text takes."""
        renderer = self.canvas.get_renderer()
        return float(renderer.get_text_width_height_descent(text, fonts(size, weight), False)[0]) / self.figure.dpi

    def axes(self, x: float, y: float, width: float, height: float, label: str = "") -> Axes:
        """Axes over a box, in whose frame one may draw."""
        box = (x / self.width, y / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(box, label=label)

    def shape(self, shape: Patch, x: float, y: float) -> None:
        """Draw a shape whose coordinates are inches from (``x``, ``y``); axes of its own would take far longer."""
        to_sheet = Affine2D().translate(x, y).scale(1 / self.width, 1 / self.height)
        shape.set_transform(to_sheet + self.figure.transFigure)
        self.figure.add_artist(shape, clip=False)


def wrap(text: str, room: float, measure: Callable[[str], float]) -> list[str]:
    """Lines no wider than ``room``, broken at spaces and between Chinese letters; a word that is wider than a line is
    cut with an ellipsis.
    """
    lines: list[str] = []
    for blank, word in pieces(text):
        while measure(word) > room and len(word) > 2:
            word = word[:-2] + "…"
        if lines and measure(f"{lines[-1]}{blank}{word}") <= room:
            lines[-1] += f"{blank}{word}"
        else:
            lines.append(word)
    return lines


def round_length(largest: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above ``largest`` (> 0)."""
    power = 10.0 ** math.floor(math.log10(largest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= largest * (1 + 1e-9))


def draw_image(axes: Axes, image: NDArray[np.uint8], grid: Grid, interpolation: str = "antialiased") -> None:
    """A picture (rows, columns, 3 or 4) over its grid, north up, in the grid's coordinates."""
    west, south, east, north = grid.bounds
    axes.imshow(image, extent=(west, east, south, north), interpolation=interpolation, aspect="auto", zorder=1)


def draw_coordinates(axes: Axes, grid: Grid, inches_a_metre: float) -> None:
    """Limits, frame and coordinates of a map over a grid: round values, at least 1.1 inches from one to the next."""
    west, south, east, north = grid.bounds
    axes.set(xlim=(west, east), ylim=(south, north))
    for axis, low, high in ((axes.xaxis, west, east), (axes.yaxis, south, north)):
        inches = inches_a_metre * (high - low)
        steps = MaxNLocator(nbins=max(1, min(8, int(inches / 1.1))), steps=[1, 2, 5, 10], min_n_ticks=1)
        # half a label's length from the corners, where those of the two axes would meet
        edge = 0.35 / inches_a_metre
        ticks = [t for t in steps.tick_values(low, high) if low + edge <= t <= high - edge]
        decimals = max(0, math.ceil(-math.log10((high - low) / 4)))
        axis.set_ticks(ticks, labels=[f"{t:.{decimals}f}" for t in ticks])
    axes.tick_params(colors="#555555", length=3, width=0.6)
    for label in axes.get_yticklabels():
        label.set(rotation=90, verticalalignment="center")
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set_fontproperties(fonts(SMALL))
    axes.spines[:].set(color="#777777", linewidth=0.6)


def draw_scale_bar(sheet: Sheet, x: float, y: float, room: float, inches_a_metre: float) -> None:
    """A two-part bar of a round length, at most ``room`` inches; ``y`` is its lower edge."""
    length = round_length(room / inches_a_metre)
    width = length * inches_a_metre
    for start, colour in ((0.0, INK), (width / 2, "white")):
        half = Rectangle((start, 0), width / 2, 0.09, facecolor=colour, edgecolor=INK, lw=0.8, label="scale bar")
        sheet.shape(half, x, y)
    unit, per = ("km", 1000.0) if length >= 2000 else ("m", 1.0) if length >= 1 else ("cm", 0.01)
    # the middle is named only where its number has room
    for share in (0.0, 0.5, 1.0) if width > 1.0 else (0.0, 1.0):
        label = f"{length * share / per:g}" + (f" {unit}" if share == 1.0 else "")
        sheet.text(x + share * width, y - 0.12, label, ha="center")


def draw_north(sheet: Sheet, x: float, y: float, word: str = "N") -> None:
    """An arrow 0.45 inches high with its N, or another word, centred on ``x``; ``y`` is its lower end."""
    for side, colour in ((0.0, INK), (0.24, "white")):
        half = ((side, 0.0), (0.12, 0.32), (0.12, 0.08))
        sheet.shape(Polygon(half, facecolor=colour, edgecolor=INK, lw=0.6), x - 0.12, y)
    sheet.text(x, y + 0.41, word, BODY, weight="bold", ha="center")


def draw_colour_bar(
    sheet: Sheet,
    box: tuple[float, float, float, float],
    colours: NDArray[np.uint8],
    ticks: Sequence[float],
    labels: Sequence[str],
    *,
    vertical: bool = False,
) -> None:
    """Colours (n, 3) in ``box`` (x, y, width, height; inches) from the first of the ``ticks`` to the last."""
    axes = sheet.axes(*box, "legend")
    shown = ScalarMappable(Normalize(ticks[0], ticks[-1]), ListedColormap(colours / 255.0))
    bar = sheet.figure.colorbar(shown, cax=axes, orientation="vertical" if vertical else "horizontal")
    bar.set_ticks(list(ticks), labels=list(labels))
    bar.outline.set(linewidth=0.6, edgecolor=INK)
    axes.tick_params(length=0, colors=INK, pad=3)
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set_fontproperties(fonts(SMALL))


def draw_signed_bar(
    sheet: Sheet,
    box: tuple[float, float, float, float],
    colours: NDArray[np.uint8],
    limit: float,
    *,
    signed: bool = True,
    vertical: bool = False,
) -> None:
    """Colour bar from ``-limit`` to ``limit``; without signs where both sides are of one kind."""
    ticks = [share * limit for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    values = [f"{tick:+.4g}" if signed else f"{abs(tick):.4g}" for tick in ticks]
    labels = [value.replace("-", "−") if tick else "0" for value, tick in zip(values, ticks, strict=True)]
    draw_colour_bar(sheet, box, colours, ticks, labels, vertical=vertical)


def draw_legend(sheet: Sheet, box: tuple[float, float, float, float], heatmap: Heatmap, *, vertical: bool) -> None:
    """Colour bar of a heatmap in ``box``, centred on zero; grey where change is below the median level."""
    limit, backdrop, words = heatmap.limit, heatmap.backdrop, heatmap.words
    x, y, width, height = box
    values = np.linspace(-limit, limit, 401)
    # as half-transparent as in the map, and never so faint that the legend says nothing
    colours = backdrop + max(heatmap.opacity, 0.35) * (diverging_colours(values, limit).astype(np.float64) - backdrop)
    if math.isfinite(heatmap.level):
        colours[np.abs(values) < heatmap.level] = veiled(backdrop, heatmap.opacity)
    draw_signed_bar(sheet, box, np.rint(colours).astype(np.uint8), limit, signed=words.signed, vertical=vertical)
    if vertical:
        sheet.text(x, y + height + 0.36, say(words.legend), BODY)
        sheet.text(x, y + height + 0.15, say(words.high))
        sheet.text(x, y - 0.15, say(words.low))
    else:
        sheet.text(x + width / 2, y + height + 0.14, say(words.legend), BODY, ha="center")
        sheet.text(x, y + height + 0.14, say(words.low))
        sheet.text(x + width, y + height + 0.14, say(words.high), ha="right")


def draw_key(
    sheet: Sheet,
    x: float,
    y: float,
    lines: Sequence[str],
    *,
    face: str = "none",
    edge: str = "none",
    width: float = 0.24,
) -> None:
    """A box of ``width`` inches, whose middle is at ``y``, and next to it what it means, in one or two lines."""
    sheet.shape(Rectangle((0, 0), width, 0.14, facecolor=face, edgecolor=edge, lw=0.8), x, y - 0.07)
    for number, line in enumerate(lines):
        sheet.text(x + width + 0.06, y + 0.15 * ((len(lines) - 1) / 2 - number), line)
