"""The list of the zones of a layer, sorted by a click on a heading and filtered by the state of the review."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from qgis.PyQt.QtCore import QItemSelectionModel, Qt, pyqtSignal
from qgis.PyQt.QtWidgets import QAbstractItemView, QComboBox, QHBoxLayout, QLabel, QTableView, QVBoxLayout, QWidget

from ..bridge.words import tr
from .zone_model import STATE_COLUMN, StateFilter, ZoneModel, state_words
from .zone_rows import ZoneRow, counts


class ZoneList(QWidget):
    """Emits ``chosen`` when another zone becomes the current one and ``opened`` at a double click."""

    chosen = pyqtSignal()
    opened = pyqtSignal()

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self.model, self.filter = ZoneModel(self), StateFilter(self)
        self.filter.setSourceModel(self.model)
        self.view = QTableView()
        self.view.setModel(self.filter)
        letters = self.view.font()
        letters.setPointSizeF(0.9 * letters.pointSizeF())
        for part in (self.view, self.view.horizontalHeader()):
            part.setFont(letters)
        self.view.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.view.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.view.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.view.setSortingEnabled(True)
        self.view.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.view.verticalHeader().hide()
        self.view.verticalHeader().setDefaultSectionSize(self.view.fontMetrics().height() + 8)
        self.view.horizontalHeader().setStretchLastSection(True)
        self.view.horizontalHeader().setHighlightSections(False)
        self.view.horizontalHeader().setMinimumSectionSize(24)
        self.view.doubleClicked.connect(lambda _: self.opened.emit())
        self.view.selectionModel().currentRowChanged.connect(lambda *_: self.chosen.emit())
        self.states = QComboBox()
        self.states.addItem(tr("All zones"), "")
        for state, word in state_words().items():
            self.states.addItem(word, state)
        self.states.currentIndexChanged.connect(lambda _: self.filter.set_state(str(self.states.currentData())))
        self.summary = QLabel()
        row = QHBoxLayout()
        row.addWidget(self.states)
        row.addWidget(self.summary)
        row.addStretch()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addLayout(row)
        layout.addWidget(self.view)

    def show_rows(self, rows: list[ZoneRow], colours: Mapping[int, str] = MappingProxyType({})) -> None:
        """Show other zones, or the same ones with other entries; the selected ones stay so. ``colours`` of alerts."""
        current, selected = self.current(), {row.feature for row in self.selected()}
        first = not self.model.rows
        self.model.set_rows(rows, colours)
        words = state_words()
        self.summary.setText(", ".join(f"{number} {words[state]}" for state, number in counts(rows).items() if number))
        if first:
            self.view.resizeColumnsToContents()
        self.view.resizeColumnToContents(STATE_COLUMN)
        for number in range(self.filter.rowCount()):
            row = self._row(self.filter.index(number, 0))
            if current is not None and row.feature == current.feature:
                self.view.setCurrentIndex(self.filter.index(number, 0))
        flag = QItemSelectionModel.SelectionFlag
        for number in range(self.filter.rowCount()):
            index = self.filter.index(number, 0)
            if self._row(index).feature in selected:
                self.view.selectionModel().select(index, flag.Select | flag.Rows)

    def choose(self, feature: int) -> bool:
        """Make a zone the current one; False where it is not listed."""
        for number in range(self.filter.rowCount()):
            index = self.filter.index(number, 0)
            if self._row(index).feature == feature:
                self.view.selectRow(number)
                self.view.scrollTo(index)
                return True
        return False

    def current(self) -> ZoneRow | None:
        """The zone that the charts show."""
        index = self.view.currentIndex()
        return self._row(index) if index.isValid() else None

    def selected(self) -> list[ZoneRow]:
        """The zones that a review is entered for."""
        return [self._row(index) for index in self.view.selectionModel().selectedRows()]

    def _row(self, index: Any) -> ZoneRow:
        return self.model.rows[self.filter.mapToSource(index).row()]
