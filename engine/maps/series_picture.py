"""One picture of a series: where the slope moves how fast, and each zone's change survey by survey."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.dates import date2num

from ..core.arrays import Bool
from ..core.number_text import fixed
from ..core.staged_outputs import atomic_output
from ..series.tables import About, zone_polygon
from ..series.velocity import CellVelocity
from ..series.zone_series import ZoneSeries
from ..statistics.normal import Z95
from .map_parts import (
    SMALL,
    Sheet,
    draw_coordinates,
    draw_image,
    draw_key,
    draw_north,
    draw_scale_bar,
    draw_signed_bar,
)
from .palette import colour_limit, diverging_colours
from .picture_words import date_axis, fonts, say

_MAX_LINES = 8  # more cannot be distinguished


def write_series_picture(
    path: Path, zones: Sequence[ZoneSeries], velocity: CellVelocity, about: About, footer: str, unseen: Bool
) -> None:
    """Write the velocity map with the zones in the colours of their alerts, and the series of the highest of them.

    Bars are 95 % intervals. At most eight zones get a line: those with the highest alert, then the fastest.

    Args:
        unseen: ground (rows, columns) that the last survey did not compare; it is hatched.
    """
    sheet = Sheet(13.0, 5.6, dpi=110)
    ends = (about.dates[0].isoformat(), about.dates[-1].isoformat())
    title = say("{0} to {1}, {2} surveys").format(*ends, len(about.dates))
    sheet.text(6.5, 5.4, title, 12.0, ha="center")
    _map(sheet, zones, velocity, about, unseen)
    _chart(sheet.axes(7.4, 0.85, 5.4, 4.1), zones, about)
    sheet.text(6.5, 0.15, say(footer), 8.5, ha="center")
    with atomic_output(path) as partial:
        sheet.figure.savefig(partial, format="png", metadata={"Software": None})


def _ranked(zones: Sequence[ZoneSeries]) -> list[ZoneSeries]:
    return sorted(zones, key=lambda z: (-z.alert.level, -z.fastest))


def _map(sheet: Sheet, zones: Sequence[ZoneSeries], velocity: CellVelocity, about: About, unseen: Bool) -> None:
    rate = 1000 * velocity.rate
    with np.errstate(invalid="ignore"):
        beyond = np.abs(velocity.rate) > Z95 * velocity.error
    limit = colour_limit(rate[beyond], level=1000 * Z95 * float(np.nanmedian(velocity.error)))
    image = np.where(np.isfinite(rate), 217, 255).astype(np.uint8)[..., np.newaxis].repeat(3, axis=2)
    image[beyond] = diverging_colours(rate[beyond], limit)
    west, south, east, north = about.grid.bounds
    inches = min(5.6 / (east - west), 3.5 / (north - south))
    wide, tall = inches * (east - west), inches * (north - south)
    axes = sheet.axes(0.6 + (5.6 - wide) / 2, 1.4 + (3.5 - tall) / 2, wide, tall, "map")
    draw_image(axes, image, about.grid, "nearest")
    if unseen.any():
        axes.contourf(
            np.flipud(unseen).astype(np.float64),
            levels=[0.5, 1.5],
            colors="none",
            hatches=["////"],
            extent=(west, east, south, north),
            zorder=2,
        )
    draw_coordinates(axes, about.grid, inches)
    for zone in zones:
        shape = zone_polygon(zone.cells, about.grid).buffer(about.grid.cell).buffer(-about.grid.cell)
        for part in shapely.get_parts(shape):
            for colour, width in (("white", 2.6), (zone.alert.colour, 1.5)):
                axes.plot(*np.array(part.exterior.coords).T, color=colour, linewidth=width, scalex=False, scaley=False)
        axes.annotate(
            zone.track.zone_id,
            (shape.centroid.x, shape.centroid.y),
            fontproperties=fonts(8),
            ha="center",
            va="center",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )
    draw_north(sheet, 0.75, 0.5)
    draw_scale_bar(sheet, 1.25, 0.65, 1.6, inches)
    draw_signed_bar(sheet, (3.6, 0.65, 2.6, 0.16), diverging_colours(np.linspace(-1, 1, 256), 1.0), limit)
    sheet.text(
        4.9,
        0.95,
        say("velocity (mm/day): red lowers, blue rises, grey within its error, hatched not compared"),
        ha="center",
    )
    used = {zone.alert.level: zone.alert for zone in zones}
    x = 0.6
    for level in sorted(used, reverse=True):
        words = f"{level} {say(used[level].name)}"
        draw_key(sheet, x, 5.13, [words], face=used[level].colour)
        x += 0.6 + sheet.text_width(words, SMALL)


def _chart(axes: Axes, zones: Sequence[ZoneSeries], about: About) -> None:
    days = np.asarray(date2num(about.dates))
    for number, zone in enumerate(_ranked(zones)[:_MAX_LINES]):
        known = np.flatnonzero(np.isfinite(zone.change))
        label = zone.track.zone_id
        if zone.velocity is not None:
            v = zone.velocity
            rate, low, high = (fixed(1000 * value, 2, sign=True) for value in (v.rate, v.low, v.high))
            label += ": " + say("{0} mm/day ({1} to {2})").format(rate, low, high)
        axes.errorbar(
            days[known],
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
    date_axis(axes.xaxis)
    axes.set_ylabel(say("mean change of the zone against the first survey (m)"), fontproperties=fonts(10))
    if zones:
        axes.legend(prop=fonts(8))
        title = say("{0} of {1} zones, bars 95 %").format(min(len(zones), _MAX_LINES), len(zones))
    else:
        axes.set_xlim(days[0], days[-1])
        title = say("no change above the level of detection")
    axes.set_title(title, fontproperties=fonts(10))
