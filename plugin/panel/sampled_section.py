"""A section through a zone that the run's own table has none for: the cells of its rasters along a straight line."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsGeometry,
    QgsPointXY,
    QgsProject,
    QgsRasterLayer,
)

from ..bridge.words import tr
from .section_vectors import vectors_near
from .sections import Place, Section

MARGIN_M = 2.0
"""On both sides of the zone, so that ground that did not change is seen too."""
_GRID = 9  # places along each side of the zone's box, of which the slope is found
_LONGEST = 4000  # places along a line

Sampler = Callable[[QgsPointXY], float]


def sampled_section(folder: Path, zone: str, outline: QgsGeometry, crs: QgsCoordinateReferenceSystem) -> Section | None:
    """Down the slope through the middle of a zone, or along its longer side where no heights are known.

    Args:
        folder: output folder of a run; of a series, the change of the last survey since the first is taken.
        outline: the zone, in ``crs``.

    Returns:
        None where the folder has no raster of the change.
    """
    change, level = _rasters(folder)
    if change is None:
        return None
    shape = QgsGeometry(outline)
    if shape.isEmpty() or shape.transform(QgsCoordinateTransform(crs, change.crs(), QgsProject.instance())) != 0:
        return None
    heights = QgsRasterLayer(str(folder / "surface_heights.tif"), "heights")
    read = [_sampler(heights, 1), _sampler(heights, 2), _sampler(change, 1), _sampler(level, 1)]
    down = _downhill(shape, read[1])
    east, north = down or _longer_side(shape)
    cell = change.rasterUnitsPerPixelX()
    middle = shape.centroid().asPoint()
    reach = [(v.x() - middle.x()) * east + (v.y() - middle.y()) * north for v in shape.vertices()]
    begin, end = min(reach) - MARGIN_M, max(reach) + MARGIN_M
    count = min(max(2, math.ceil((end - begin) / cell)), _LONGEST)
    points = []
    for number in range(count + 1):
        along = begin + (end - begin) * number / count
        points.append(QgsPointXY(middle.x() + along * east, middle.y() + along * north))
    step = (end - begin) / count
    places = [Place(number * step, *(one(point) for one in read)) for number, point in enumerate(points)]
    name = tr("Straight down the slope through {}") if down else tr("Along {}")
    line = QgsGeometry.fromPolylineXY([points[0], points[-1]])
    return Section(name.format(zone), tuple(places), vectors_near(folder, line, change.crs()))


def _rasters(folder: Path) -> tuple[QgsRasterLayer | None, QgsRasterLayer | None]:
    """The change and its level of detection."""
    if (folder / "elevation_change.tif").is_file():
        found = [folder / "elevation_change.tif", folder / "level_of_detection.tif"]
    else:
        last = max((folder / "cumulative").glob("elevation_change_*.tif"), default=None)
        if last is None:
            return None, None
        found = [last, last.with_name(last.name.replace("elevation_change", "level_of_detection"))]
    change, level = (QgsRasterLayer(str(path), path.stem) for path in found)
    return (change, level) if change.isValid() else (None, None)


def _sampler(layer: QgsRasterLayer | None, band: int) -> Sampler:
    """What a raster holds at a point; NaN without data."""
    if layer is None or not layer.isValid() or layer.bandCount() < band:
        return lambda point: math.nan
    provider = layer.dataProvider()

    def sample(point: QgsPointXY) -> float:
        value, known = provider.sample(point, band)
        return float(value) if known else math.nan

    return sample


def _downhill(shape: QgsGeometry, height: Sampler) -> tuple[float, float] | None:
    """The direction in which the plane through the heights within a zone's box falls; None where it does not."""
    box = shape.boundingBox()
    found = []
    for row in range(_GRID):
        for column in range(_GRID):
            x = box.xMinimum() + box.width() * column / (_GRID - 1)
            y = box.yMinimum() + box.height() * row / (_GRID - 1)
            z = height(QgsPointXY(x, y))
            if math.isfinite(z):
                found.append((x, y, z))
    slope = _gradient(found)
    steepness = math.hypot(*slope)
    return None if steepness < math.tan(math.radians(2.0)) else (-slope[0] / steepness, -slope[1] / steepness)


def _gradient(points: Sequence[tuple[float, float, float]]) -> tuple[float, float]:
    """Of the plane that fits points best by least squares; level where they do not make one."""
    if len(points) < 3:
        return 0.0, 0.0
    x0, y0, z0 = (sum(column) / len(points) for column in zip(*points))
    offsets = [(x - x0, y - y0, z - z0) for x, y, z in points]
    xx, xy, yy = (sum(p[a] * p[b] for p in offsets) for a, b in ((0, 0), (0, 1), (1, 1)))
    xz, yz = (sum(p[a] * p[2] for p in offsets) for a in (0, 1))
    determinant = xx * yy - xy * xy
    if determinant <= 1e-9 * max(xx, yy) ** 2:
        return 0.0, 0.0
    return (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant


def _longer_side(shape: QgsGeometry) -> tuple[float, float]:
    """The direction of the longer side of the smallest box around a zone."""
    box = shape.orientedMinimumBoundingBox()[0]  # named: its corners are gone with it
    corners = [QgsPointXY(v.x(), v.y()) for v in box.vertices()]
    begin, end = max(zip(corners, corners[1:3]), key=lambda side: side[0].distance(side[1]))
    length = begin.distance(end)
    return ((end.x() - begin.x()) / length, (end.y() - begin.y()) / length) if length else (1.0, 0.0)
