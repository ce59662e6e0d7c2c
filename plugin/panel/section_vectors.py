"""Displacement vectors near a section: their motion along the line and upwards, as a report's profiles draw them."""

from __future__ import annotations

import math
from pathlib import Path

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsFeature,
    QgsGeometry,
    QgsPointXY,
    QgsProject,
    QgsVectorLayer,
)

from .sections import SectionVector

FILE, LAYER = "displacement.gpkg", "vectors"
LINES = "profiles.gpkg"
_STEP_M = 0.01  # along the line, over which its direction at a place is taken
_ON_THE_LINE_M = 1e-6


def line_of(folder: Path, name: str) -> tuple[QgsGeometry, QgsCoordinateReferenceSystem] | None:
    """The line of a profile of a run's table; None where the run has none of the name."""
    layer = _layer(folder / LINES, "profiles")
    if layer is None:
        return None
    for feature in layer.getFeatures():
        if feature["name"] == name:
            return QgsGeometry(feature.geometry()), layer.crs()
    return None


def vectors_near(folder: Path, line: QgsGeometry, crs: QgsCoordinateReferenceSystem) -> tuple[SectionVector, ...]:
    """The run's significant vectors that lie within half of their own window of a line, in the order along it.

    Args:
        folder: output folder of a run; of a series, the motion of the last survey since the first is taken.
        line: of a section, in ``crs``, of one part.

    Returns:
        None of them where the run has measured no motion along the surface.
    """
    layer = _layer(folder / FILE, LAYER)
    if layer is None:
        return ()
    way = QgsGeometry(line)
    if way.isEmpty() or way.transform(QgsCoordinateTransform(crs, layer.crs(), QgsProject.instance())) != 0:
        return ()
    way.convertToSingleType()
    found = [_in_plane(feature, way) for feature in _last_survey(layer)]
    return tuple(sorted((one for one in found if one is not None), key=lambda one: one.distance))


def _layer(path: Path, name: str) -> QgsVectorLayer | None:
    layer = QgsVectorLayer(f"{path}|layername={name}", name, "ogr") if path.is_file() else None
    return layer if layer is not None and layer.isValid() else None


def _last_survey(layer: QgsVectorLayer) -> list[QgsFeature]:
    """The rows of a pair; of a series those of its last survey."""
    rows = list(layer.getFeatures())
    if "days" not in layer.fields().names():
        return rows
    last = max((row["days"] for row in rows), default=0)
    return [row for row in rows if row["days"] == last]


def _in_plane(feature: QgsFeature, line: QgsGeometry) -> SectionVector | None:
    """The motion along the line and upwards; None where the vector lies too far off or beyond the line's ends."""
    point = feature.geometry()
    distance, off, length = line.lineLocatePoint(point), line.distance(point), line.length()
    foot = line.interpolate(distance)
    # what lies beyond the ends is on no section
    if not (off <= feature["window_m"] / 2 and 0 < distance < length and foot.distance(point) <= off + _ON_THE_LINE_M):
        return None
    ends = [line.interpolate(min(max(distance + side * _STEP_M / 2, 0.0), length)).asPoint() for side in (-1, 1)]
    east, north = _direction(*ends)
    return SectionVector(distance, feature["east_m"] * east + feature["north_m"] * north, float(feature["up_m"]))


def _direction(begin: QgsPointXY, end: QgsPointXY) -> tuple[float, float]:
    east, north = end.x() - begin.x(), end.y() - begin.y()
    length = math.hypot(east, north)
    return (east / length, north / length) if length else (0.0, 0.0)
