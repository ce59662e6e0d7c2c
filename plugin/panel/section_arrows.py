"""Displacement vectors in the chart of a section: arrows in its plane, longer than in truth, as in the report."""

from __future__ import annotations

import math
from collections.abc import Sequence

from qgis.PyQt.QtCore import QPointF, QRectF
from qgis.PyQt.QtGui import QColor, QFontMetricsF, QPainter

from ..bridge.words import tr
from .axes import finite
from .chart_painter import Panel
from .sections import Place, Section, SectionVector

VECTOR = QColor("#b31818")
"""As on the maps of QGIS and of the report."""
LIFT = 0.1
"""Of the heights that are shown, by which arrows stand over the surface, which would hide them."""
_ARROW_SHARE = 0.08  # of a section's length, which the longest arrows take
_LONGEST_SHARE = 0.9  # of the arrows are not longer than these


def magnification(vectors: Sequence[SectionVector], length: float) -> float:
    """How many times as long as in truth arrows on a section of ``length`` metres are drawn: 1, 2, 5, 10 and so on."""
    amounts = sorted(abs(one.along) for one in vectors)
    place = _LONGEST_SHARE * (len(amounts) - 1)
    below, above = amounts[math.floor(place)], amounts[math.ceil(place)]
    longest = below + (above - below) * (place - math.floor(place))
    wanted = max(_ARROW_SHARE * length / max(longest, 1e-3), 1.0)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step for step in (1.0, 2.0, 5.0) if step == 1.0 or step * power <= wanted) * power


def surface_at(places: Sequence[Place], distance: float) -> float:
    """Mean height of both surveys at a distance along a section, between the places where it is known; NaN without."""
    known = [(p.distance, sum(both) / len(both)) for p in places if (both := finite((p.height_from, p.height_to)))]
    before = max((one for one in known if one[0] <= distance), default=None)
    after = min((one for one in known if one[0] >= distance), default=None)
    if before is None or after is None:
        return (before or after or (0.0, math.nan))[1]
    width = after[0] - before[0]
    return before[1] + (after[1] - before[1]) * ((distance - before[0]) / width if width else 0.0)


def draw_over_surface(panel: Panel, section: Section) -> None:
    """Arrows just over both surfaces. They keep their direction against the drawn surface, whatever the exaggeration
    of heights: what slides along it is parallel to it.
    """
    if not section.vectors:
        return
    times = times_of(section)
    lift = LIFT * (panel.up.high - panel.up.low) / (1 + LIFT)
    for one in section.vectors:
        height = surface_at(section.places, one.distance)
        if math.isfinite(height):
            panel.arrow((one.distance, height + lift), (times * one.along, times * one.up), VECTOR)


def draw_alone(panel: Panel, section: Section) -> None:
    """Arrows from the middle of a panel whose axes have the same scale, where no heights are known."""
    times = times_of(section)
    for one in section.vectors:
        panel.arrow((one.distance, 0.0), (times * one.along, times * one.up), VECTOR)


def times_of(section: Section) -> float:
    """The magnification of a section's arrows."""
    return magnification(section.vectors, section.places[-1].distance)


def explain(painter: QPainter, row: QRectF, section: Section) -> None:
    """Write at the end of a row what the arrows are."""
    painter.setPen(VECTOR)
    left = max(row.right() - note_width(painter, section), row.left())
    painter.drawText(QPointF(left, row.top() + QFontMetricsF(painter.font()).ascent()), _note(section))


def note_width(painter: QPainter, section: Section) -> float:
    """Pixels that ``explain`` takes."""
    return float(QFontMetricsF(painter.font()).horizontalAdvance(_note(section)))


def _note(section: Section) -> str:
    return tr("arrows: motion, {0} times as long").format(f"{times_of(section):g}")
