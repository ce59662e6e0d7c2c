"""The engine's arguments for a dialog's values, and layers to be given to a dialog."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qgis.core import (
    QgsFeature,
    QgsGeometry,
    QgsProcessingContext,
    QgsProject,
    QgsVectorFileWriter,
    QgsVectorLayer,
)
from slopewatch.processing_algorithms.values import Values
from slopewatch.tests.builders.qgis import Recorder


def command(algorithm: Any, feedback: Recorder | None = None, **parameters: Any) -> list[str]:
    """The engine's arguments for these values."""
    made = algorithm().create()
    context = QgsProcessingContext()
    context.setProject(QgsProject.instance())
    return made.command(Values(made, parameters, context, feedback or Recorder()))


def square(layer: str, west: float, crs: str = "EPSG:32651") -> QgsVectorLayer:
    polygons = QgsVectorLayer(f"Polygon?crs={crs}", layer, "memory")
    for shift in (0, 100):
        feature = QgsFeature()
        x = west + shift
        feature.setGeometry(QgsGeometry.fromWkt(f"POLYGON(({x} 0, {x + 10} 0, {x + 10} 10, {x} 10, {x} 0))"))
        polygons.dataProvider().addFeature(feature)
    return polygons


def line(layer: str, crs: str = "EPSG:32651") -> QgsVectorLayer:
    lines = QgsVectorLayer(f"LineString?crs={crs}", layer, "memory")
    feature = QgsFeature()
    feature.setGeometry(QgsGeometry.fromWkt("LINESTRING(-100 -20, 300 -20)"))
    lines.dataProvider().addFeature(feature)
    return lines


def written(layer: QgsVectorLayer, path: Path, name: str, *, append: bool = False) -> Path:
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.layerName = name
    if append:
        options.actionOnExistingFile = QgsVectorFileWriter.ActionOnExistingFile.CreateOrOverwriteLayer
    error = QgsVectorFileWriter.writeAsVectorFormatV3(
        layer, str(path), QgsProject.instance().transformContext(), options
    )
    assert error[0] == QgsVectorFileWriter.WriterError.NoError, error
    return path
