"""Regions and stable ground that were drawn: layers of a GeoPackage, offered to the dialogs of the toolbox."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qgis.core import (
    Qgis,
    QgsCategorizedSymbolRenderer,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsDataProvider,
    QgsFeature,
    QgsField,
    QgsFields,
    QgsFillSymbol,
    QgsGeometry,
    QgsProject,
    QgsRendererCategory,
    QgsSingleSymbolRenderer,
    QgsVectorFileWriter,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QDateTime, Qt

from ..bridge.compat import STRING
from ..bridge.words import tr

FILE = "slopewatch_areas.gpkg"
_KIND, _DRAWN = "slopewatch/area", "slopewatch/drawn"  # properties of a layer, which a project keeps


class AreaError(Exception):
    """A polygon that cannot be taken or kept; the message is for the user."""


@dataclass(frozen=True)
class Kind:
    """``table`` in the GeoPackage, ``parameter`` of the algorithms, title of the layer, colour on the map, and texts of
    each polygon; ``together`` says that one layer holds all. ``classes``: value of the first text, label and colour.
    """

    table: str
    parameter: str
    title: str
    colour: str
    fields: tuple[str, ...] = ("name",)
    together: bool = True
    classes: tuple[tuple[str, str, str], ...] = ()


REGION = Kind("region", "ROI", "Region of interest (drawn)", "#e08214", together=False)
STABLE = Kind("stable_ground", "STABLE", "Stable ground (drawn)", "#1b7837")
KINDS = (REGION, STABLE)


def add_area(
    kind: Kind, polygon: QgsGeometry, path: Path, project: QgsProject, crs: Any = None, values: Any = None
) -> QgsVectorLayer:
    """Keep a polygon as a layer of a GeoPackage and of the project.

    Every region is a layer of its own, so that an earlier one is not added to it; pieces of stable ground are together.

    Args:
        crs: that of the polygon; the project's where it is not given. The layer gets it.
        values: texts by field; the polygon's number as its name where they are not given.

    Raises:
        AreaError: the outline crosses itself or has no area, there is no reference system, or the file refuses.
    """
    crs = project.crs() if crs is None else crs
    if not crs.isValid():
        raise AreaError(tr("The project has no reference system; set one, or load a layer that has one."))
    if not polygon.isGeosValid() or polygon.isEmpty() or polygon.area() <= 0:
        raise AreaError(tr("The outline crosses itself or has no area; draw it again."))
    layer = _together(kind, project, Path(path))
    if layer is None:
        layer = _kept_layer(kind, Path(path)) or _new_layer(kind, Path(path), crs)
        project.addMapLayer(layer, False)
        project.layerTreeRoot().insertLayer(0, layer)  # else it lies in the current group, which the picture may cover
    _add(layer, polygon, crs, project, values)
    layer.setCustomProperty(_KIND, kind.table)
    layer.setCustomProperty(_DRAWN, QDateTime.currentDateTimeUtc().toString(Qt.DateFormat.ISODateWithMs))
    layer.triggerRepaint()
    return layer


def drawn_areas(project: QgsProject) -> dict[str, str]:
    """The layer drawn last of each kind, as values of the algorithms' parameters: parameter to layer's id."""
    found: dict[str, str] = {}
    for kind in KINDS:
        layers = [layer for layer in project.mapLayers().values() if layer.customProperty(_KIND) == kind.table]
        if layers:
            found[kind.parameter] = max(layers, key=lambda layer: str(layer.customProperty(_DRAWN))).id()
    return found


def _together(kind: Kind, project: QgsProject, path: Path) -> QgsVectorLayer | None:
    """The layer of the project that a further polygon is added to."""
    if not kind.together:
        return None
    for layer in project.mapLayers().values():
        if layer.customProperty(_KIND) == kind.table and Path(layer.source().partition("|")[0]) == path:
            return layer
    return None


def _kept_layer(kind: Kind, path: Path) -> QgsVectorLayer | None:
    """The layer that the file of an output folder holds already, which need not be loaded."""
    if kind in KINDS or kind.table not in _tables(path):
        return None
    return _styled(kind, QgsVectorLayer(f"{path}|layername={kind.table}", tr(kind.title)))


def _new_layer(kind: Kind, path: Path, crs: QgsCoordinateReferenceSystem) -> QgsVectorLayer:
    """An empty layer under a name that is free in the GeoPackage, with its style."""
    taken, (table, number) = _tables(path), (kind.table, 1)
    while table in taken:
        number += 1
        table = f"{kind.table}_{number}"
    fields = QgsFields()
    for name in kind.fields:
        fields.append(QgsField(name, STRING))
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.driverName, options.layerName, options.fileEncoding = "GPKG", table, "UTF-8"
    action = QgsVectorFileWriter.ActionOnExistingFile
    options.actionOnExistingFile = action.CreateOrOverwriteLayer if path.exists() else action.CreateOrOverwriteFile
    project = QgsProject.instance()
    writer = QgsVectorFileWriter.create(
        str(path), fields, Qgis.WkbType.Polygon, crs, project.transformContext(), options
    )
    failed, why = writer.hasError() != QgsVectorFileWriter.WriterError.NoError, writer.errorMessage()
    del writer  # which closes the file
    layer = QgsVectorLayer(f"{path}|layername={table}", tr(kind.title) if number == 1 else f"{tr(kind.title)} {number}")
    if failed or not layer.isValid():
        raise AreaError(tr("{} cannot be written: {}.").format(path, why or tr("choose another folder")))
    return _styled(kind, layer)


def _styled(kind: Kind, layer: QgsVectorLayer) -> QgsVectorLayer:
    if kind.classes:
        looks = [QgsRendererCategory(value, _outline(colour), tr(label)) for value, label, colour in kind.classes]
        layer.setRenderer(QgsCategorizedSymbolRenderer(kind.fields[0], looks))
    else:
        layer.setRenderer(QgsSingleSymbolRenderer(_outline(kind.colour)))
    return layer


def _outline(colour: str) -> QgsFillSymbol:
    return QgsFillSymbol.createSimple({"style": "no", "outline_color": colour, "outline_width": "0.7"})


def _tables(path: Path) -> set[str]:
    """The layers of a GeoPackage; none where there is no file yet."""
    layer = QgsVectorLayer(str(path), "", "ogr")  # named: its provider is gone with it
    names = layer.dataProvider().subLayers() if path.is_file() and layer.isValid() else []
    return {name.split(QgsDataProvider.sublayerSeparator())[1] for name in names}


def _add(layer: QgsVectorLayer, polygon: QgsGeometry, crs: Any, project: QgsProject, values: Any) -> None:
    shape = QgsGeometry(polygon)
    if crs != layer.crs():
        shape.transform(QgsCoordinateTransform(crs, layer.crs(), project))
    feature = QgsFeature(layer.fields())
    for name, text in (values or {"name": str(layer.featureCount() + 1)}).items():
        feature[name] = text
    feature.setGeometry(shape)
    added, _ = layer.dataProvider().addFeatures([feature])
    if not added:
        raise AreaError(tr("{} cannot be written: {}.").format(layer.source(), tr("choose another folder")))
    layer.updateExtents()
