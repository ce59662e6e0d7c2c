"""Run inside QGIS by ``qgis --code``: the layers of motion along the surface, as the plugin loads them, with pictures.

Its task is described in qgis_session.py; its parameters are RUN, the output folder of an inspection, a displacement or
a series, and PREFIX, with which the names of the pictures begin.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis.core import (
    QgsDateTimeRange,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QDateTime, QTime
from qgis.utils import iface
from slopewatch.lab.sessions.qgis_session import TASK, QgisSession
from slopewatch.plugin.bridge.styling import StylePostProcessor
from slopewatch.processing_algorithms import inspectseries, products

_SCALES = (250, 100)
_HIDDEN = ("Hazard zones", "Zones and alert levels", "Significant change (m)", "Velocity (mm/day)")
_RASTERS = ("Displacement (m)", "Smallest motion")


class MotionSession(QgisSession):
    """Pictures of the whole, the largest zone, each layer that is off at first, and each survey of a series."""

    def steps(self) -> list[Callable[[], bool | None]]:
        self._folder = Path(TASK["parameters"]["RUN"])
        self._is_series = (self._folder / "series.gpkg").is_file()
        self._views = [self.whole, *(self.at_scale(scale) for scale in _SCALES)]
        for name in ("Motion known in one direction", "Displacement (m)", "Smallest motion that can be told (m)"):
            self._views.append(self.with_layer(name))
        if self._is_series:
            self._views += [self.at_survey(number) for number in range(len(self.days()))]
        look = [self.change_view, self.draw_view]
        return [self.open_window, self.load, *look * len(self._views), self.finish]

    def days(self) -> list[Any]:
        layer = QgsVectorLayer(f"{self._folder}/displacement.gpkg|layername=vectors", "vectors", "ogr")
        index = layer.fields().indexOf("time_to")
        return sorted(layer.uniqueValues(index)) if index >= 0 else []

    def load(self) -> None:
        """All products that the folder holds, in their order in the tree."""
        tables = inspectseries._PRODUCTS if self._is_series else products.CHANGE_PRODUCTS + products.MOTION_PRODUCTS
        project, context, feedback = QgsProject.instance(), QgsProcessingContext(), QgsProcessingFeedback()
        context.setProject(project)
        group = project.layerTreeRoot().addGroup("SlopeWatch")
        for product in sorted(tables, key=lambda product: -product.appearance.order):
            path = self._folder / product.file_name
            if not path.is_file() or not (product.by_default or product in products.MOTION_PRODUCTS or self._is_series):
                continue
            if product.layer:
                layer: Any = QgsVectorLayer(f"{path}|layername={product.layer}", product.label, "ogr")
            else:
                layer = QgsRasterLayer(str(path), product.label)
            if layer.isValid():
                project.addMapLayer(layer, False)
                group.addLayer(layer)
                StylePostProcessor.create(product.appearance, layer.name()).postProcessLayer(layer, context, feedback)
        self.report_layers()

    def change_view(self) -> None:
        self._waited = 0
        self._name = self._views.pop(0)()

    def draw_view(self) -> bool:
        if not self.drawn("") or self._waited < 12:
            return True
        self.picture(TASK["parameters"]["PREFIX"] + self._name)
        return False

    # --- views --------------------------------------------------------------------------------------------------

    def whole(self) -> str:
        iface.mapCanvas().setDestinationCrs(self.motion().crs())
        self.show_extent(self.motion_extent(), 1.1)
        return "whole"

    def at_scale(self, scale: int) -> Callable[[], str]:
        def view() -> str:
            boxes = [feature.geometry().boundingBox() for feature in self.largest()]
            self.show_extent(boxes[0] if boxes else self.motion_extent(), 1.0)
            iface.mapCanvas().zoomScale(scale)
            return f"scale_{scale}"

        return view

    def with_layer(self, name: str) -> Callable[[], str]:
        def view() -> str:
            self.show_extent(self.motion_extent(), 1.1)
            for node in QgsProject.instance().layerTreeRoot().findLayers():
                if node.name().startswith((*_HIDDEN, *_RASTERS)):
                    node.setItemVisibilityChecked(False)
                    node.setExpanded(False)
                if node.name().startswith(name):
                    node.setItemVisibilityChecked(True)
                    node.setExpanded(True)
            return "with_" + name.split(" ")[0].lower()

        return view

    def at_survey(self, number: int) -> Callable[[], str]:
        def view() -> str:
            for node in QgsProject.instance().layerTreeRoot().findLayers():
                on = node.name().startswith(
                    ("Motion along the surface, survey", "Zones of coherent motion", "Top view")
                )
                node.setItemVisibilityChecked(on)
            day = self.days()[number].date()
            moment = QDateTime(day, QTime(0, 0))
            iface.mapCanvas().setTemporalRange(QgsDateTimeRange(moment, moment))
            return f"survey_{number}"

        return view

    # --- helpers ------------------------------------------------------------------------------------------------

    def motion(self) -> Any:
        layers = QgsProject.instance().mapLayers().values()
        return next(layer for layer in layers if layer.name().startswith(("Motion along", "Displacement (m)")))

    def motion_extent(self) -> QgsRectangle:
        return QgsRasterLayer(str(self._folder / "displacement.tif")).extent()

    def largest(self) -> list[Any]:
        layer = QgsVectorLayer(f"{self._folder}/displacement.gpkg|layername=zones", "zones", "ogr")
        return sorted(layer.getFeatures(), key=lambda feature: -feature["area_m2"])

    def show_extent(self, extent: QgsRectangle, share: float) -> None:
        extent.scale(share)
        iface.mapCanvas().setExtent(extent)
        iface.mapCanvas().refresh()


MotionSession.begin()
