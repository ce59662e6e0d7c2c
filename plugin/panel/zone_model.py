"""The table of zones that the panel shows, and which of its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from qgis.PyQt.QtCore import QAbstractTableModel, QModelIndex, QSortFilterProxyModel, Qt
from qgis.PyQt.QtGui import QColor

from ...interface.reviews import CONFIRMED, REJECTED, UNREVIEWED
from ...interface.rounding import significant_decimals
from ..bridge.words import tr
from .zone_rows import ZoneRow

SORT_ROLE = Qt.ItemDataRole.UserRole
STATE_COLUMN, GRADE_COLUMN = 1, 3
_TOP = QModelIndex()
_COLOURS = {CONFIRMED: QColor("#1b7837"), REJECTED: QColor("#8a8f98")}


def state_words() -> dict[str, str]:
    """The states of a review in the language of QGIS."""
    return {UNREVIEWED: tr("unreviewed"), CONFIRMED: tr("confirmed"), REJECTED: tr("rejected")}


class ZoneModel(QAbstractTableModel):
    """A row a zone; the columns are those that one decides by."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self.rows: Sequence[ZoneRow] = ()
        self.colours: Mapping[int, str] = {}

    def set_rows(self, rows: Sequence[ZoneRow], colours: Mapping[int, str] = MappingProxyType({})) -> None:
        """Other rows; ``colours`` of alert levels."""
        self.beginResetModel()
        self.rows, self.colours = tuple(rows), colours
        self.endResetModel()

    def rowCount(self, parent: QModelIndex = _TOP) -> int:
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: QModelIndex = _TOP) -> int:
        return 0 if parent.isValid() else len(self._headings())

    def headerData(self, section: int, orientation: Any, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return self._headings()[section]
        return None

    def data(self, index: QModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row = self.rows[index.row()]
        if role == Qt.ItemDataRole.DisplayRole:
            return self._texts(row)[index.column()]
        if role == SORT_ROLE:
            return self._values(row)[index.column()]
        if role == Qt.ItemDataRole.TextAlignmentRole and index.column() in (4, 5):
            right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
            return right.value if hasattr(right, "value") else int(right)  # a table takes the number only
        if role == Qt.ItemDataRole.ForegroundRole and index.column() == STATE_COLUMN:
            return _COLOURS.get(row.state)
        if role == Qt.ItemDataRole.DecorationRole and index.column() == GRADE_COLUMN and row.alert is not None:
            colour = self.colours.get(row.alert.level)
            return None if colour is None else QColor(colour)
        if role == Qt.ItemDataRole.ToolTipRole and index.column() == GRADE_COLUMN and row.alert is not None:
            return f"{row.alert.words(tr)}. {row.alert.reason_words(tr)}".strip()
        if role == Qt.ItemDataRole.ToolTipRole:
            notes = [row.reviewer, row.remarks, row.photo]
            return "\n".join(note for note in notes if note) or None
        return None

    def _headings(self) -> list[str]:
        grade = tr("Alert") if any(row.alert is not None for row in self.rows) else tr("Severity")
        return [
            tr("Zone"), tr("Review"), tr("Kind"), grade, tr("Mean (m)"), tr("Area (m²)"), tr("Date"),
        ]  # fmt: skip

    def _texts(self, row: ZoneRow) -> list[str]:
        change = "" if row.change is None else f"{row.change:+.3f}"
        decimals = 1 if row.alert is None or row.area is None else significant_decimals(row.area)
        area = "" if row.area is None else f"{row.area:.{decimals}f}"
        mark = " ✎" if row.remarks else ""
        mark += " ▣" if row.photo else ""
        state = state_words().get(row.state, row.state) + mark
        grade = row.severity if row.alert is None else row.alert.short(tr)
        return [row.name, state, tr(row.kind), grade, change, area, row.date]

    def _values(self, row: ZoneRow) -> list[Any]:
        grade = row.severity if row.alert is None else str(row.alert.level)
        return [row.name, row.state, row.kind, grade, row.change or 0.0, row.area or 0.0, row.date]


class StateFilter(QSortFilterProxyModel):
    """The zones of one state, or all."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self._state = ""
        self.setSortRole(SORT_ROLE)

    def set_state(self, state: str) -> None:
        self._state = state
        self.invalidateFilter()

    def filterAcceptsRow(self, row: int, parent: QModelIndex) -> bool:
        return not self._state or self.sourceModel().rows[row].state == self._state
