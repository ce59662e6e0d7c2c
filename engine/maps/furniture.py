"""Parts of an annotated map in inches from the figure's lower left: text, scale bar, north arrow, legend."""

from __future__ import annotations

import math
from collections.abc import Callable

from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Polygon, Rectangle

INK = "#222222"
BODY, SMALL = 9.0, 7.5  # points
# asked for in this order; what is not installed is left out, because matplotlib warns about it
_FAMILIES = ("DejaVu Sans", "Noto Sans CJK SC", "WenQuanYi Zen Hei", "Microsoft YaHei", "PingFang SC")


class Sheet:
    """A figure addressed in inches, with one font."""

    def __init__(self, figure: Figure, width: float, height: float) -> None:
        self.figure, self.width, self.height = figure, width, height
        installed = {font.name for font in font_manager.fontManager.ttflist}
        self.font = FontProperties(family=[name for name in _FAMILIES if name in installed] or ["sans-serif"])
        figure.set_size_inches(width, height)
        figure.set_facecolor("white")

    def fonts(self, size: float, weight: str = "normal") -> FontProperties:
        font = self.font.copy()
        font.set_size(size)
        font.set_weight(weight)
        return font

    def text(
        self, x: float, y: float, text: str, size: float = SMALL, *, weight: str = "normal", ha: str = "left"
    ) -> None:
        """Write one line whose vertical middle is at ``y``."""
        font = self.fonts(size, weight)
        place = x / self.width, y / self.height
        self.figure.text(*place, text, fontproperties=font, color=INK, ha=ha, va="center", parse_math=False)

    def axes(self, x: float, y: float, width: float, height: float) -> Axes:
        """Axes over a box, in whose frame one may draw."""
        return self.figure.add_axes((x / self.width, y / self.height, width / self.width, height / self.height))

    def canvas(self, x: float, y: float, width: float, height: float) -> Axes:
        """Like ``axes``, without frame, whose coordinates are inches from the box's lower left."""
        axes = self.axes(x, y, width, height)
        axes.set_axis_off()
        axes.set_xlim(0, width)
        axes.set_ylim(0, height)
        return axes


def wrap(text: str, room: float, measure: Callable[[str], float]) -> list[str]:
    """Lines no wider than ``room``, broken at spaces; a word that is wider than a line is cut with an ellipsis."""
    lines: list[str] = []
    for word in text.split(" "):
        while measure(word) > room and len(word) > 2:
            word = word[:-2] + "…"
        if lines and measure(f"{lines[-1]} {word}") <= room:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


def round_length(largest: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above ``largest`` (> 0)."""
    power = 10.0 ** math.floor(math.log10(largest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= largest * (1 + 1e-9))


def draw_scale_bar(sheet: Sheet, x: float, y: float, room: float, inches_a_metre: float) -> None:
    """A two-part bar of a round length, at most ``room`` inches; ``y`` is its lower edge."""
    length = round_length(room / inches_a_metre)
    width = length * inches_a_metre
    axes = sheet.canvas(x, y, width, 0.09)
    axes.set_label("scale bar")
    for start, colour in ((0.0, INK), (width / 2, "white")):
        axes.add_patch(Rectangle((start, 0), width / 2, 0.09, facecolor=colour, edgecolor=INK, lw=0.8, clip_on=False))
    unit, per = ("km", 1000.0) if length >= 2000 else ("m", 1.0) if length >= 1 else ("cm", 0.01)
    # the middle is named only where its number has room
    for share in (0.0, 0.5, 1.0) if width > 1.0 else (0.0, 1.0):
        label = f"{length * share / per:g}" + (f" {unit}" if share == 1.0 else "")
        sheet.text(x + share * width, y - 0.12, label, ha="center")


def draw_north(sheet: Sheet, x: float, y: float) -> None:
    """An arrow 0.45 inches high with its N, centred on ``x``; ``y`` is its lower end."""
    axes = sheet.canvas(x - 0.12, y, 0.24, 0.32)
    left, right = ((0.0, 0.0), (0.12, 0.32), (0.12, 0.08)), ((0.24, 0.0), (0.12, 0.32), (0.12, 0.08))
    axes.add_patch(Polygon(left, facecolor=INK, edgecolor=INK, lw=0.6, clip_on=False))
    axes.add_patch(Polygon(right, facecolor="white", edgecolor=INK, lw=0.6, clip_on=False))
    sheet.text(x, y + 0.41, "N", BODY, weight="bold", ha="center")
