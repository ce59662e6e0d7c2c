"""Table and picture of what growth was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from .growth_law import Law
from .growth_store import Measured

Series = Mapping[str, Sequence[tuple[float, float, float]]]
COLOURS = {"ground": "#1b6ca8", "register": "#c0392b", "change": "#2e7d32"}
TARGET_GB = 4.0


def report(rows: Sequence[Measured], laws: Mapping[str, Law], memory: Mapping[str, Law]) -> str:
    """The tables as Markdown: each command on each size, and the laws."""
    lines = [
        "## Growth",
        "",
        (
            "| stage | points a survey | points read | processor | clock | a million points read | largest process "
            "| all processes | error; cells |"
        ),
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in sorted(rows, key=lambda row: (row.stage, row.millions)):
        start = f"| {row.stage} | {row.millions:g} M | "
        if row.reason:
            lines.append(f"{start}| {row.reason} | | | | | |")
            continue
        error = "" if row.error_mm is None else f"{row.error_mm:.2f} mm"
        error = error if row.cell_m is None else f"{row.cell_m:g} m"
        lines.append(
            f"{start}{row.points / 1e6:.2f} M | {row.cpu:.0f} s | {row.seconds:.0f} s "
            f"| {1e6 * row.cpu / row.points:.1f} s | {row.peak / 1e9:.2f} GB | {row.together / 1e9:.2f} GB | {error} |"
        )
    lines += ["", "| stage | processor time grows with | memory of all processes grows with |", "|---|---|---|"]
    for stage, law in laws.items():
        lines.append(f"| {stage} | {_words(law)} | {_words(memory[stage])} |")
    days = sorted({row.day for row in rows if not row.reason})
    states = sorted({row.code for row in rows if not row.reason})
    lines += ["", f"Measured {', '.join(days)} on SlopeWatch {', '.join(states)}."]
    return "\n".join(lines) + "\n"


def _words(law: Law) -> str:
    return f"n^{law.exponent:.3f} (standard error {law.error:.3f})"


def draw(path: Path, series: Series, laws: Mapping[str, Law], memory: Mapping[str, Law]) -> None:
    """Processor time and memory against points read, both in logarithms, with the laws as lines."""
    figure = Figure(figsize=(10, 4.2), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    for stage, points in series.items():
        sizes, seconds, held = np.array(points, dtype=float).T
        colour = COLOURS.get(stage, "black")
        for axes, values, fits, name in (
            (left, seconds, laws, "n^{:.2f} ± {:.2f}"),
            (right, held / 1e9, memory, "n^{:.2f} ± {:.2f}"),
        ):
            law = fits.get(stage)
            label = stage if law is None else f"{stage}: {name.format(law.exponent, law.error)}"
            axes.plot(sizes / 1e6, values, "o", color=colour, label=label)
            if law is not None:
                scale = 1.0 if axes is left else 1e-9
                axes.plot(sizes / 1e6, [scale * law(size) for size in sizes], "-", color=colour, linewidth=1)
    right.axhline(TARGET_GB, color="grey", linestyle="--", linewidth=1, label=f"{TARGET_GB:g} GB")
    for axes, title in ((left, "Processor time, s"), (right, "Memory of all processes, GB")):
        axes.set(xscale="log", yscale="log", xlabel="points read, million", title=title)
        for axis in (axes.xaxis, axes.yaxis):
            # the labels of logarithms overlap where an axis spans one decade
            axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        axes.grid(visible=True, which="both", linewidth=0.3)
        axes.legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
