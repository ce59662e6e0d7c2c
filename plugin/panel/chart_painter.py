"""Charts drawn with Qt's painter: a frame with axes, lines, ribbons, dots."""

from __future__ import annotations

import math
from collections.abc import Sequence

from qgis.PyQt.QtCore import QPointF, QRectF, Qt
from qgis.PyQt.QtGui import QColor, QFontMetricsF, QPainter, QPen, QPolygonF

from .axes import Axis, label, pieces

INK, SOFT, GRID = QColor("#24292f"), QColor("#57606a"), QColor("#e3e6ea")
BEFORE, AFTER = QColor("#8a8f98"), QColor("#24292f")
LOWERED, RAISED = QColor("#b43628"), QColor("#2a6bae")
RIBBON = QColor(140, 140, 140, 70)
_GAP = 4.0  # pixels between an axis and its numbers
_HEAD = 7.0  # pixels of an arrow's head
_SHORTEST = 1.0  # pixels of an arrow that is drawn


class Panel:
    """A rectangle of a chart with a horizontal and a vertical axis."""

    def __init__(self, painter: QPainter, area: QRectF, across: tuple[float, float], up: tuple[float, float]) -> None:
        self._painter, self._area = painter, area
        self.across = Axis(*across, area.left(), area.right())
        self.up = Axis(*up, area.bottom(), area.top())

    def frame(self, rows: Sequence[float], words: str) -> None:
        """The grid with the numbers of the vertical axis, and what it shows above it."""
        painter, area = self._painter, self._area
        metrics = QFontMetricsF(painter.font())
        step = rows[1] - rows[0] if len(rows) > 1 else abs(rows[0]) or 1.0
        for value in rows:
            y = self.up.at(value)
            painter.setPen(QPen(SOFT if value == 0 else GRID, 1.0))
            painter.drawLine(QPointF(area.left(), y), QPointF(area.right(), y))
            painter.setPen(SOFT)
            text = label(value, step)
            painter.drawText(
                QPointF(area.left() - _GAP - metrics.horizontalAdvance(text), y + metrics.ascent() / 2.6), text
            )
        painter.setPen(QPen(SOFT, 1.0))
        painter.drawLine(area.bottomLeft(), area.bottomRight())
        painter.drawLine(area.bottomLeft(), area.topLeft())
        painter.setPen(INK)
        painter.drawText(QPointF(area.left(), area.top() - _GAP), words)

    def columns(self, named: Sequence[tuple[float, str]], words: str = "") -> None:
        """Names along the horizontal axis, the last one first where room is short, and at its end what it shows."""
        painter, area = self._painter, self._area
        metrics = QFontMetricsF(painter.font())
        y, free, last = area.bottom() + _GAP + metrics.ascent(), -math.inf, math.inf
        for number, (value, text) in enumerate([*named[-1:], *named[:-1]]):
            x, width = self.across.at(value), metrics.horizontalAdvance(text)
            painter.setPen(QPen(SOFT, 1.0))
            painter.drawLine(QPointF(x, area.bottom()), QPointF(x, area.bottom() + 3))
            left = min(x - width / 2, area.right() + _GAP - width)  # the last one within the paper
            if left > free and left + width + 2 * _GAP < last:
                painter.drawText(QPointF(left, y), text)
                last, free = (left, free) if number == 0 else (last, left + width + 2 * _GAP)
        painter.setPen(SOFT)
        painter.drawText(QPointF(area.right() - metrics.horizontalAdvance(words), y + metrics.height()), words)

    def line(self, points: Sequence[tuple[float, float]], colour: QColor, width: float = 1.6) -> None:
        """A line that breaks where a value is not known."""
        self._painter.setPen(QPen(colour, width))
        for piece in pieces(points):
            drawn = [self._at(x, y) for x, y in piece]
            self._painter.drawPolyline(QPolygonF(drawn if len(drawn) > 1 else drawn * 2))

    def ribbon(self, points: Sequence[tuple[float, float]], colour: QColor = RIBBON) -> None:
        """The band from minus to plus the second value of each point."""
        self._painter.setPen(Qt.PenStyle.NoPen)
        self._painter.setBrush(colour)
        for piece in pieces(points):
            there, back = [self._at(x, y) for x, y in piece], [self._at(x, -y) for x, y in reversed(piece)]
            self._painter.drawPolygon(QPolygonF(there + back))
        self._painter.setBrush(Qt.BrushStyle.NoBrush)

    def bar(self, x: float, low: float, high: float, colour: QColor) -> None:
        """A vertical bar, such as that of an error."""
        self._painter.setPen(QPen(colour, 1.2))
        self._painter.drawLine(self._at(x, low), self._at(x, high))

    def dot(self, x: float, y: float, colour: QColor, radius: float = 3.2) -> None:
        """A dot at a place that is known."""
        if math.isfinite(x) and math.isfinite(y):
            self._painter.setPen(QPen(Qt.GlobalColor.white, 1.0))
            self._painter.setBrush(colour)
            self._painter.drawEllipse(self._at(x, y), radius, radius)
            self._painter.setBrush(Qt.BrushStyle.NoBrush)

    def arrow(self, begin: tuple[float, float], step: tuple[float, float], colour: QColor) -> None:
        """An arrow from a place by a step of both axes."""
        foot, tip = self._at(*begin), self._at(begin[0] + step[0], begin[1] + step[1])
        along = tip - foot
        length = math.hypot(along.x(), along.y())
        if length < _SHORTEST:
            return
        head = min(_HEAD, 0.6 * length)
        ahead = along / length
        neck, aside = tip - ahead * head, QPointF(-ahead.y(), ahead.x()) * (0.42 * head)
        self._painter.setPen(QPen(colour, 1.4))
        self._painter.drawLine(foot, neck)
        self._painter.setPen(Qt.PenStyle.NoPen)
        self._painter.setBrush(colour)
        self._painter.drawPolygon(QPolygonF([tip, neck + aside, neck - aside]))
        self._painter.setBrush(Qt.BrushStyle.NoBrush)

    def _at(self, x: float, y: float) -> QPointF:
        return QPointF(self.across.at(x), self.up.at(y))
