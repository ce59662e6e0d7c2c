"""Sections with displacement vectors: arrows in the plane of the section, as long as the drawn surface allows."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ..core.number_text import fixed
from ..maps.map_parts import INK, SMALL, Sheet
from ..maps.motion_map import ZONE
from ..maps.picture_words import fonts
from ..zones.profiles import Profile
from ..zones.section_vectors import SectionVectors
from .charts import finish
from .embedding import Picture, drawing
from .vector_arrows import draw_vectors

_WIDE = 7.2  # inches
_BEFORE = "#8a8f98"


def section_chart(profile: Profile, vectors: SectionVectors, inside: BaseGeometry, epochs: tuple[str, str]) -> Picture:
    """Heights of both surveys along a line, with the vectors near it; what of the line lies in the zone is shaded.

    Args:
        inside: the line within the zone.
    """
    sheet = Sheet(_WIDE, 2.0)
    axes = sheet.axes(0.6, 0.42, 6.5, 1.33)
    for heights, colour, width, name in (
        (profile.height_from, _BEFORE, 1.6, epochs[0]),
        (profile.height_to, INK, 0.8, epochs[1]),
    ):
        label = name.replace("$", r"\$")
        axes.plot(profile.distance, heights, color=colour, lw=width, label=label, solid_capstyle="butt")
    line = profile.line.geometry
    for part in shapely.get_parts(inside):
        ends = [line.project(shapely.Point(place)) for place in shapely.get_coordinates(part)[[0, -1]]]
        axes.axvspan(*sorted(ends), color=ZONE, alpha=0.1, lw=0)
    axes.set_xlim(0, line.length)
    finish(axes, "distance along the line (m)", "height (m)")
    draw_vectors(axes, profile.distance, (profile.height_from, profile.height_to), vectors)
    axes.legend(
        loc="upper right", frameon=False, ncols=2, prop=fonts(SMALL), borderaxespad=0.1, handlelength=1.6,
        bbox_to_anchor=(1.0, 1.17),
    )  # fmt: skip
    if not len(vectors):
        return drawing(sheet.figure, f"Section of {line.length:.1f} m through the zone, near which no vector lies")
    along, up = (float(np.median(part)) for part in (vectors.along, vectors.up))
    return drawing(
        sheet.figure,
        f"Section of {line.length:.1f} m down the zone with {len(vectors)} displacement vectors near it; their median "
        f"is {fixed(along, 3, sign=True)} m along the section and {fixed(up, 3, sign=True)} m upwards",
    )
