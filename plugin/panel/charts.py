"""The widgets that draw the section and the time series of a zone."""

from __future__ import annotations

import math
from typing import Any

from qgis.PyQt.QtCore import QPointF, QRectF, QSize, Qt
from qgis.PyQt.QtGui import QFontMetricsF, QPainter, QTextOption
from qgis.PyQt.QtWidgets import QWidget

from ..bridge.words import tr
from .axes import label, span, ticks
from .chart_painter import AFTER, BEFORE, INK, LOWERED, RAISED, RIBBON, SOFT, Panel
from .courses import Course
from .section_arrows import LIFT, draw_alone, draw_over_surface, explain, note_width
from .sections import Section

_SMALLER = 0.85  # of the window's letters
_EDGE = 10.0  # pixels around the whole
_WORDS_GAP = 4.0  # pixels between a panel and the words over it
_STRIP = 0.35  # of the chart, for arrows without heights


class Chart(QWidget):
    """White paper with a title and a chart, or one sentence where there is nothing to draw."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self.sentence = ""
        self.setMinimumHeight(190)

    def sizeHint(self) -> QSize:
        return QSize(360, 280)

    def paintEvent(self, event: Any) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), Qt.GlobalColor.white)
        font = painter.font()
        font.setPointSizeF(max(6.0, font.pointSizeF() * _SMALLER))
        painter.setFont(font)
        if self.sentence:
            painter.setPen(SOFT)
            centred = QTextOption(Qt.AlignmentFlag.AlignCenter)
            painter.drawText(QRectF(self.rect()).adjusted(16, 8, -16, -8), self.sentence, centred)
        else:
            self.draw(painter, QRectF(self.rect()))
        painter.end()

    def say(self, sentence: str) -> None:
        """Show a sentence instead of a chart."""
        self.sentence = sentence
        self.update()

    def draw(self, painter: QPainter, whole: QRectF) -> None:
        """Draw into ``whole``."""


class SectionChart(Chart):
    """Heights of both surveys with the displacement vectors above, the change with its level of detection below."""

    section: Section | None = None

    def show_section(self, section: Section) -> None:
        self.section, self.sentence = section, ""
        self.update()

    def draw(self, painter: QPainter, whole: QRectF) -> None:
        section = self.section
        if section is None:
            return
        area = _titled(painter, whole, section.name)
        across = span([p.distance for p in section.places], margin=0.0)
        if section.has_heights:
            upper, area = _parted(painter, area, 0.5)
            self._draw_heights(painter, upper, across, section)
        elif section.vectors:
            upper, area = _parted(painter, area, _STRIP)
            explain(painter, _row_above(painter, upper), section)
            half = 0.5 * upper.height() / upper.width() * (across[1] - across[0])
            draw_alone(Panel(painter, upper, across, (-half, half)), section)
        self._draw_change(painter, area, across, section)

    def _draw_heights(self, painter: QPainter, area: QRectF, across: tuple[float, float], section: Section) -> None:
        words, metrics = tr("height (m): grey before, black after"), QFontMetricsF(painter.font())
        low, high = span([h for p in section.places for h in (p.height_from, p.height_to)])
        if section.vectors:
            high += LIFT * (high - low)
            note = _row_above(painter, area)
            both = metrics.horizontalAdvance(words + "  ") + note_width(painter, section)
            if both > area.width():  # a row of its own
                area = area.adjusted(0, 1.2 * metrics.height(), 0, 0)
            explain(painter, note, section)
        panel = Panel(painter, area, across, (low, high))
        panel.frame(ticks(low, high, 4), words)
        panel.line([(p.distance, p.height_from) for p in section.places], BEFORE)
        panel.line([(p.distance, p.height_to) for p in section.places], AFTER)
        draw_over_surface(panel, section)

    def _draw_change(self, painter: QPainter, area: QRectF, across: tuple[float, float], section: Section) -> None:
        known = [p for p in section.places if math.isfinite(p.change)]
        changes = span([v for p in known for v in (p.change, p.level, -p.level, 0.0)])
        panel = Panel(painter, area, across, changes)
        panel.ribbon([(p.distance, p.level) for p in section.places])
        panel.frame(ticks(*changes, 4), tr("change (m), grey: level of detection"))
        panel.line([(p.distance, p.change) for p in section.places], INK, 1.2)
        for place in known:
            if abs(place.change) > place.level:
                panel.dot(place.distance, place.change, LOWERED if place.change < 0 else RAISED, 2.6)
        steps = ticks(*across, 6)
        step = steps[1] - steps[0] if len(steps) > 1 else 1.0
        panel.columns([(value, label(value, step)) for value in steps], tr("metres along the line"))


class CourseChart(Chart):
    """Mean change of a zone since the first survey, with standard errors and the level of detection as a ribbon."""

    course: Course | None = None

    def show_course(self, course: Course) -> None:
        self.course, self.sentence = course, ""
        self.update()

    def draw(self, painter: QPainter, whole: QRectF) -> None:
        course = self.course
        if course is None:
            return
        area = _titled(painter, whole, tr("{} since {}").format(course.zone, course.begin.isoformat()))
        begin = float(course.begin.toordinal())
        places = [(float(s.day.toordinal()), s) for s in course.surveys]
        across = span([begin, *(x for x, _ in places)], margin=0.03, smallest=2.0)
        values = [
            v for _, s in places for v in (s.change - _known(s.error), s.change + _known(s.error), s.level, -s.level)
        ]
        up = span([0.0, *values])
        panel = Panel(painter, area, across, up)
        first = [(begin, places[0][1].level)] if places else []
        panel.ribbon([*first, *((x, s.level) for x, s in places)], RIBBON)
        panel.frame(ticks(*up, 5), tr("mean change (m), grey: level of detection"))
        panel.line([(begin, 0.0), *((x, s.change) for x, s in places)], INK)
        for x, survey in places:
            panel.bar(x, survey.change - _known(survey.error), survey.change + _known(survey.error), INK)
            within = not abs(survey.change) > survey.level
            panel.dot(x, survey.change, BEFORE if within else LOWERED if survey.change < 0 else RAISED)
        days = [course.begin, *(s.day for s in course.surveys)]
        panel.columns([(float(day.toordinal()), day.isoformat()) for day in days], tr("survey"))


def _titled(painter: QPainter, whole: QRectF, title: str) -> QRectF:
    """Write the title; gives the rectangle between the axes."""
    font = painter.font()
    font.setBold(True)
    painter.setFont(font)
    painter.setPen(INK)
    metrics = QFontMetricsF(font)
    text = metrics.elidedText(title, Qt.TextElideMode.ElideRight, whole.width() - 2 * _EDGE)
    painter.drawText(QPointF(_EDGE, _EDGE + metrics.ascent()), text)
    font.setBold(False)
    painter.setFont(font)
    letter = QFontMetricsF(font)
    left, top = letter.horizontalAdvance("-00.000") + _EDGE, _EDGE + 2.5 * letter.height()
    return whole.adjusted(left, top, -_EDGE, -_EDGE - 2.3 * letter.height())


def _parted(painter: QPainter, area: QRectF, share: float) -> tuple[QRectF, QRectF]:
    """The panels above, which takes a share of the height, and below, with room for words between them."""
    words = 1.6 * QFontMetricsF(painter.font()).height()
    height = share * (area.height() - words)
    upper = QRectF(area.left(), area.top(), area.width(), height)
    return upper, area.adjusted(0, height + words, 0, 0)


def _row_above(painter: QPainter, area: QRectF) -> QRectF:
    """Where the words over a panel stand."""
    metrics = QFontMetricsF(painter.font())
    return QRectF(area.left(), area.top() - _WORDS_GAP - metrics.ascent(), area.width(), metrics.height())


def _known(value: float) -> float:
    return value if math.isfinite(value) else 0.0
