"""The SlopeWatch panel: a dock from drawing the region to the reviewed report."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from qgis.core import Qgis, QgsFeatureRequest, QgsProject, QgsRectangle, QgsVectorLayer
from qgis.gui import QgsMapToolIdentifyFeature
from qgis.PyQt.QtCore import QSignalBlocker, Qt, QTimer, QUrl
from qgis.PyQt.QtGui import QDesktopServices
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QDockWidget,
    QFileDialog,
    QFrame,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QScrollArea,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

from ..bridge.translated_style import translate_style
from ..bridge.words import tr
from .alerts import level_colours
from .area_bar import AreaBar
from .buttons import button
from .corrections import CorrectionsButton
from .report_task import ReportTask
from .review_bar import ReviewBar
from .run_folder import UNSEEN_LAYER, ZONE_LAYER, report_of, run_folder, zone_files
from .zone_charts import ZoneCharts
from .zone_list import ZoneList
from .zone_rows import ZoneRow, is_zones_layer, zone_layers, zone_rows

NAME = "SlopeWatchPanel"
_AROUND = 0.6  # of a zone's size, on each side of it on the map
_SMALLEST_M = 3.0


class SlopeWatchPanel(QDockWidget):
    """``open_dialog`` opens the dialog of an algorithm with values filled in."""

    def __init__(self, iface: Any, open_dialog: Any) -> None:
        super().__init__(tr("SlopeWatch"), iface.mainWindow())
        self.setObjectName(NAME)
        self._iface, self._canvas = iface, iface.mapCanvas()
        self._layer: QgsVectorLayer | None = None
        self._picker: Any = None
        self._before: Any = None  # the tool that was active before
        self._task: ReportTask | None = None
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self.refresh)
        self.areas = AreaBar(self._canvas, self.say, open_dialog)
        self.corrections = CorrectionsButton(
            self._canvas, self.areas.draw_for, self._folder, lambda *said: self.say(*said), open_dialog
        )
        self.layers = QComboBox()
        self.layers.currentIndexChanged.connect(lambda _: self._take_layer())
        self.zones, self.charts = ZoneList(), ZoneCharts()
        self.reviews = ReviewBar(lambda: (self._layer, self.zones.selected()), self.say)
        self.zones.chosen.connect(self._show_zone)
        self.zones.opened.connect(self.zoom)
        self.zones.view.selectionModel().selectionChanged.connect(lambda *_: self.reviews.refresh())
        self.sentence = QLabel()
        self.sentence.setWordWrap(True)
        self.sentence.setMargin(8)
        scrolled = QScrollArea()
        scrolled.setWidgetResizable(True)
        scrolled.setFrameShape(QFrame.Shape.NoFrame)
        scrolled.setWidget(self._laid_out())
        whole = QWidget()
        layout = QVBoxLayout(whole)
        layout.setContentsMargins(0, 0, 0, 6)
        layout.addWidget(scrolled)
        layout.addWidget(self.sentence)
        self.setWidget(whole)
        project = QgsProject.instance()
        project.layersAdded.connect(self._list_layers)
        project.layersRemoved.connect(self._list_layers)
        self._list_layers()

    # --- the parts ----------------------------------------------------------------------------------------------

    def _laid_out(self) -> QWidget:
        area_box, zone_box = QGroupBox(tr("Areas")), QGroupBox(tr("Zones"))
        QVBoxLayout(area_box).addWidget(self.areas)
        splitter = QSplitter(Qt.Orientation.Vertical)
        splitter.addWidget(self.zones)
        splitter.addWidget(self.charts)
        splitter.setStretchFactor(0, 1)
        splitter.setStretchFactor(1, 1)
        inside = QVBoxLayout(zone_box)
        inside.addLayout(self._run_row())
        inside.addLayout(self._map_row())
        inside.addWidget(splitter)
        inside.addWidget(self.reviews)
        inside.addLayout(self._report_row())
        whole = QWidget()
        layout = QVBoxLayout(whole)
        layout.addWidget(area_box)
        layout.addWidget(zone_box, 1)
        return whole

    def _run_row(self) -> QHBoxLayout:
        row = QHBoxLayout()
        self.open_run = button(
            tr("Open run…"), tr("Load the zones of an output folder"), self.ask_run, "/mActionFileOpen.svg"
        )
        row.addWidget(self.layers, 1)
        row.addWidget(self.open_run)
        return row

    def _map_row(self) -> QHBoxLayout:
        row = QHBoxLayout()
        self.zoom_button = button(
            tr("Zoom to"), tr("Bring the zone on the map"), self.zoom, "/mActionZoomToSelected.svg"
        )
        self.flash_button = button(tr("Flash"), tr("Flash the zone on the map"), self.flash)
        self.pick_button = button(
            tr("Pick on map"),
            tr("Choose a zone by a click on the map"),
            self.pick,
            "/mActionIdentify.svg",
            checkable=True,
        )
        for one in (self.zoom_button, self.flash_button, self.pick_button, self.corrections):
            row.addWidget(one)
        row.addStretch()
        return row

    def _report_row(self) -> QHBoxLayout:
        row = QHBoxLayout()
        self.report_button = button(
            tr("Open report"), tr("Open the report of the run in the browser"), self.open_report
        )
        self.write_button = button(
            tr("Write report"), tr("Save the reviews and make the report again with them"), self.write_report
        )
        for one in (self.report_button, self.write_button):
            row.addWidget(one)
        row.addStretch()
        return row

    # --- layers and zones ---------------------------------------------------------------------------------------

    def layer(self) -> QgsVectorLayer | None:
        """The layer whose zones are listed."""
        return self._layer

    def _folder(self) -> Path | None:
        """The output folder of the run whose zones are listed."""
        return run_folder(self._layer.source()) if self._layer is not None else None

    def load_run(self, folder: Path) -> list[QgsVectorLayer]:
        """Load the zones of an output folder, or take those that are loaded already, and list the first ones."""
        found: list[QgsVectorLayer] = []
        for path in zone_files(folder):
            source = f"{path}|layername={ZONE_LAYER}"
            layer = next((one for one in zone_layers(QgsProject.instance()) if one.source() == source), None)
            if layer is None:
                layer = QgsVectorLayer(source, f"{folder.name} {path.stem}", "ogr")
                if not is_zones_layer(layer):
                    continue
                translate_style(layer)
                if not found:
                    _add_unseen(path, f"{folder.name}: {tr('Not seen')}")
                QgsProject.instance().addMapLayer(layer)
                node = QgsProject.instance().layerTreeRoot().findLayer(layer.id())
                if node is not None and found:
                    node.setItemVisibilityChecked(False)  # the first ones are what one looks at first
            found.append(layer)
        if found:
            self.layers.setCurrentIndex(self.layers.findData(found[0].id()))
        else:
            self.say(tr("{} holds no zones of a run; choose an output folder of SlopeWatch.").format(folder), True)
        return found

    def ask_run(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, tr("Output folder of a run"))
        if folder:
            self.load_run(Path(folder))

    def refresh(self) -> None:
        """Read the zones of the layer again."""
        rows = zone_rows(self._layer) if self._layer is not None else []
        folder = self._folder()
        self.zones.show_rows(rows, level_colours(folder))
        self.reviews.refresh()
        self.report_button.setEnabled(report_of(folder) is not None)
        self.write_button.setEnabled(folder is not None and self._task is None)
        self.corrections.setEnabled(folder is not None)
        for one in (self.zoom_button, self.flash_button, self.pick_button):
            one.setEnabled(bool(rows))

    def _list_layers(self, *_: Any) -> None:
        chosen = self.layers.currentData()
        blocker = QSignalBlocker(self.layers)
        self.layers.clear()
        for layer in zone_layers(QgsProject.instance()):
            self.layers.addItem(layer.name(), layer.id())
            self.layers.setItemData(self.layers.count() - 1, layer.source(), Qt.ItemDataRole.ToolTipRole)
        place = self.layers.findData(chosen)
        self.layers.setCurrentIndex(max(place, 0) if self.layers.count() else -1)
        del blocker
        self.areas.refresh()
        self._take_layer()

    def _take_layer(self) -> None:
        """List the zones of the layer that is chosen."""
        layer = QgsProject.instance().mapLayer(str(self.layers.currentData() or ""))
        if layer is self._layer and layer is not None:
            return
        self._layer = layer
        self.charts.clear()
        if layer is not None:
            for signal in (
                layer.attributeValueChanged,
                layer.afterRollBack,
                layer.afterCommitChanges,
                layer.dataChanged,
            ):
                signal.connect(self._soon)
            layer.undoStack().indexChanged.connect(self._soon)
            layer.selectionChanged.connect(self._follow_map)
        self.zones.show_rows([])
        self.refresh()

    def _soon(self, *_: Any) -> None:
        """Refresh once for a row of changes, and after the layer is done with them."""
        self._timer.start(0)

    def _follow_map(self, *_: Any) -> None:
        if self._layer is not None and len(self._layer.selectedFeatureIds()) == 1:
            self.zones.choose(self._layer.selectedFeatureIds()[0])

    def _show_zone(self) -> None:
        row = self.zones.current()
        if row is not None and self._layer is not None:
            self.charts.show_zone(self._layer, row)

    # --- the map ------------------------------------------------------------------------------------------------

    def zoom(self) -> None:
        """Bring the selected zones on the map, with what is around them."""
        ids = self._ids()
        if not ids or self._layer is None:
            return
        box = QgsRectangle()
        for feature in self._layer.getFeatures(QgsFeatureRequest().setFilterFids(ids).setNoAttributes()):
            box.combineExtentWith(feature.geometry().boundingBox())
        box = self._canvas.mapSettings().layerExtentToOutputExtent(self._layer, box)
        box.grow(max(_AROUND * max(box.width(), box.height()), _SMALLEST_M))
        self._canvas.setExtent(box)
        self._canvas.refresh()

    def flash(self) -> None:
        if self._layer is not None:
            self._canvas.flashFeatureIds(self._layer, self._ids())

    def pick(self) -> None:
        """Choose zones by clicks on the map, until the button is released or another tool is taken."""
        if not self.pick_button.isChecked() or self._layer is None:
            if self._picker is not None and self._canvas.mapTool() is self._picker:
                self._canvas.unsetMapTool(self._picker)
                if self._before is not None:
                    self._canvas.setMapTool(self._before)
            return
        self._before = self._canvas.mapTool()
        self._picker = QgsMapToolIdentifyFeature(self._canvas, self._layer)
        self._picker.featureIdentified.connect(lambda f: self.zones.choose(f.id()))
        self._picker.deactivated.connect(lambda: self.pick_button.setChecked(False))
        self._canvas.setMapTool(self._picker)

    def _ids(self) -> list[int]:
        current = self.zones.current()
        rows: list[ZoneRow] = self.zones.selected() or ([] if current is None else [current])
        return [row.feature for row in rows]

    # --- the report ---------------------------------------------------------------------------------------------

    def open_report(self) -> None:
        report = report_of(self._folder())
        if report is not None:
            QDesktopServices.openUrl(QUrl.fromLocalFile(os.fspath(report)))

    def write_report(self) -> None:
        """Save what was entered and have the engine make the report again."""
        folder = self._folder()
        if folder is None or self._task is not None or not self.reviews.keep():
            return
        self.say(tr("The report of {} is being made.").format(folder), False)
        self._task = ReportTask(folder, lambda there, why: self._reported(folder, there, why))
        self.write_button.setEnabled(False)
        self._task.start()

    def _reported(self, folder: Path, there: bool, why: str) -> None:
        self._task = None
        self.refresh()
        self.say(tr("The report of {} is there.").format(folder) if there else why, not there)

    def say(self, sentence: str, warning: bool) -> None:
        """Show a sentence below the panel, a warning also above the map."""
        self.sentence.setText(sentence)
        if warning:
            self._iface.messageBar().pushMessage("SlopeWatch", sentence, Qgis.MessageLevel.Warning, 10)

    def close_down(self) -> None:
        """Let go of the project and of the map, before the plugin is unloaded."""
        project = QgsProject.instance()
        project.layersAdded.disconnect(self._list_layers)
        project.layersRemoved.disconnect(self._list_layers)
        self.areas.stop()
        if self._picker is not None:
            self._canvas.unsetMapTool(self._picker)
        self._timer.stop()
        self._layer = None


def _add_unseen(path: Path, title: str) -> None:
    """Have the map hatch what the surveys of a run did not compare; the zones come above."""
    unseen = QgsVectorLayer(f"{path}|layername={UNSEEN_LAYER}", title, "ogr")
    if unseen.isValid() and unseen.featureCount():
        translate_style(unseen)
        QgsProject.instance().addMapLayer(unseen)
