"""One picture of a series: where the slope moves how fast, and each zone's change survey by survey."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..core.number_text import fixed
from ..core.staged_outputs import atomic_output
from ..series.tables import About, zone_polygon
from ..series.velocity import CellVelocity
from ..series.zone_series import ZoneSeries
from ..statistics.normal import Z95
from .palette import DIVERGING, colour_limit, hexadecimal

_MAX_LINES = 8  # more cannot be distinguished


def write_series_picture(
    path: Path, zones: Sequence[ZoneSeries], velocity: CellVelocity, about: About, footer: str
) -> None:
    """Write the velocity map with the zones in the colours of their alerts, and the series of the highest of them.

    Bars are 95 % intervals. At most eight zones get a line: those with the highest alert, then the fastest.
    """
    figure = Figure(figsize=(13, 5.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    place, chart = figure.subplots(1, 2, width_ratios=(1.05, 1))
    _map(figure, place, zones, velocity, about)
    _chart(chart, zones, about)
    figure.suptitle(f"{about.dates[0].isoformat()} to {about.dates[-1].isoformat()}, {len(about.dates)} surveys")
    figure.supxlabel(footer, fontsize=8.5, color="#444444")
    with atomic_output(path) as partial:
        figure.savefig(partial, format="png", metadata={"Software": None})


def _ranked(zones: Sequence[ZoneSeries]) -> list[ZoneSeries]:
    return sorted(zones, key=lambda z: (-z.alert.level, -abs(z.velocity.rate if z.velocity else 0.0)))


def _map(figure: Figure, axes, zones: Sequence[ZoneSeries], velocity: CellVelocity, about: About) -> None:  # type: ignore[no-untyped-def]
    rate = 1000 * velocity.rate
    with np.errstate(invalid="ignore"):
        beyond = np.abs(velocity.rate) > Z95 * velocity.error
    level = 1000 * Z95 * float(np.nanmedian(velocity.error))
    limit = colour_limit(rate[beyond], level=level)
    stops = sorted([(0.5 - s / 2, low) for s, low, _ in DIVERGING] + [(0.5 + s / 2, high) for s, _, high in DIVERGING])
    ramp = LinearSegmentedColormap.from_list("change", [(p, hexadecimal(c)) for p, c in dict(stops).items()])
    west, south, east, north = about.grid.bounds
    still = np.where(np.isfinite(rate), 0.85, 1.0)
    extent = (0.0, east - west, 0.0, north - south)
    axes.imshow(still, cmap="gray", vmin=0, vmax=1, extent=extent, interpolation="nearest")
    shown = axes.imshow(
        np.where(beyond, rate, np.nan), cmap=ramp, vmin=-limit, vmax=limit, extent=extent, interpolation="nearest"
    )
    for zone in zones:
        shape = zone_polygon(zone.cells, about.grid).buffer(about.grid.cell).buffer(-about.grid.cell)
        for part in getattr(shape, "geoms", [shape]):
            if part.is_empty:
                continue
            x, y = np.array(part.exterior.coords).T
            axes.plot(x - west, y - south, color="white", linewidth=2.6)
            axes.plot(x - west, y - south, color=zone.alert.colour, linewidth=1.5)
        axes.annotate(
            zone.track.zone_id,
            (shape.centroid.x - west, shape.centroid.y - south),
            fontsize=8,
            ha="center",
            va="center",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )
    bar = figure.colorbar(shown, ax=axes, orientation="horizontal", shrink=0.8, pad=0.02)
    bar.set_label("velocity (mm/day), red lowers, blue rises; grey: within its error")
    axes.set(xlabel=f"m east of {west:.0f}", ylabel=f"m north of {south:.0f}", aspect="equal")
    used = {z.alert.level: z.alert for z in zones}
    if used:
        handles = [Patch(facecolor=used[k].colour, label=f"{k} {used[k].name}") for k in sorted(used, reverse=True)]
        axes.legend(handles=handles, fontsize=8, loc="upper right")


def _chart(axes, zones: Sequence[ZoneSeries], about: About) -> None:  # type: ignore[no-untyped-def]
    for number, zone in enumerate(_ranked(zones)[:_MAX_LINES]):
        known = np.flatnonzero(np.isfinite(zone.change))
        label = zone.track.zone_id
        if zone.velocity is not None:
            v = zone.velocity
            rate, low, high = (fixed(1000 * value, 2, sign=True) for value in (v.rate, v.low, v.high))
            label += f": {rate} mm/day ({low} to {high})"
        axes.errorbar(
            [about.dates[i] for i in known],
            zone.change[known],
            yerr=Z95 * zone.error[known],
            color=f"C{number}",
            marker="o",
            markersize=4,
            capsize=2,
            linewidth=1.3,
            label=label,
        )
    axes.axhline(0, color="#666666", linewidth=0.8)
    axes.grid(color="#e5e5e5")
    locator = AutoDateLocator()
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axes.set(ylabel="mean change of the zone against the first survey (m)")
    if zones:
        axes.legend(fontsize=8)
        axes.set_title(f"{min(len(zones), _MAX_LINES)} of {len(zones)} zones, bars 95 %", fontsize=10)
    else:
        axes.set_xlim(about.dates[0], about.dates[-1])
        axes.set_title("no change above the level of detection", fontsize=10)
