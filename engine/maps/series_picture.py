"""The map of a series: where the slope moves how fast, with its zones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely

from ...interface.rates import rate_unit
from ..core.arrays import Bool
from ..core.staged_outputs import atomic_output
from ..series.tables import About, zone_polygon
from ..series.velocity import CellVelocity
from ..series.zone_series import ZoneSeries
from ..statistics.normal import Z95
from .heatmap_image import Unseen
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
from .picture_words import fonts, say
from .unseen import draw_unseen, draw_unseen_key

_WIDTH_IN, _HEIGHT_IN = 9.0, 5.9
_MAP_IN = 7.8, 3.8


def write_series_picture(
    path: Path, zones: Sequence[ZoneSeries], velocity: CellVelocity, about: About, footer: str, unseen: Bool
) -> None:
    """Write the velocity map with the zones in the colours of their alerts.

    Args:
        unseen: ground (rows, columns) that the last survey did not compare; it is hatched.
    """
    sheet = Sheet(_WIDTH_IN, _HEIGHT_IN, dpi=110)
    ends = (about.dates[0].isoformat(), about.dates[-1].isoformat())
    title = say("{0} to {1}, {2} surveys").format(*ends, len(about.dates))
    sheet.text(_WIDTH_IN / 2, 5.65, title, 12.0, ha="center")
    _map(sheet, zones, velocity, about, unseen)
    sheet.text(_WIDTH_IN / 2, 0.15, say(footer), 8.5, ha="center")
    with atomic_output(path) as partial:
        sheet.figure.savefig(partial, format="png", metadata={"Software": None})


def _map(sheet: Sheet, zones: Sequence[ZoneSeries], velocity: CellVelocity, about: About, unseen: Bool) -> None:
    unit = rate_unit([None if zone.velocity is None else 1000 * zone.velocity.rate for zone in zones])
    rate = 1000 * unit.days * velocity.rate
    with np.errstate(invalid="ignore"):
        beyond = np.abs(velocity.rate) > Z95 * velocity.error
    limit = colour_limit(rate[beyond], level=1000 * unit.days * Z95 * float(np.nanmedian(velocity.error)))
    image = np.where(np.isfinite(rate), 217, 255).astype(np.uint8)[..., np.newaxis].repeat(3, axis=2)
    image[beyond] = diverging_colours(rate[beyond], limit)
    west, south, east, north = about.grid.bounds
    inches = min(_MAP_IN[0] / (east - west), _MAP_IN[1] / (north - south))
    wide, tall = inches * (east - west), inches * (north - south)
    axes = sheet.axes(0.6 + (_MAP_IN[0] - wide) / 2, 1.4 + (_MAP_IN[1] - tall) / 2, wide, tall, "map")
    draw_image(axes, image, about.grid, "nearest")
    draw_coordinates(axes, about.grid, inches)
    if draw_unseen(axes, Unseen(unseen, about.grid), inches):
        draw_unseen_key(sheet, 5.2, 0.33)
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
    draw_signed_bar(sheet, (5.2, 0.65, 2.6, 0.16), diverging_colours(np.linspace(-1, 1, 256), 1.0), limit)
    sheet.text(
        6.0,
        0.95,
        say("velocity ({0}): red lowers, blue rises, grey within its error").format(unit.name),
        ha="center",
    )
    used = {zone.alert.level: zone.alert for zone in zones}
    x = 0.6
    for level in sorted(used, reverse=True):
        words = f"{level} {say(used[level].name)}"
        draw_key(sheet, x, 5.37, [words], face=used[level].colour)
        x += 0.6 + sheet.text_width(words, SMALL)
