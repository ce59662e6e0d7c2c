"""Rasters of heights as elevation layers: relief on the map, surfaces in QGIS's elevation profiles and 3D views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from qgis.core import Qgis, QgsHillshadeRenderer, QgsProject, QgsRasterLayer
from qgis.PyQt.QtGui import QColor

LIGHT_AZIMUTH_DEGREES, LIGHT_ANGLE_DEGREES = 315.0, 45.0
LINE_COLOURS = ("#4d4d4d", "#d7301f", "#2b6cb0", "#238b45")
"""Of the surfaces' lines in a profile, in the order of the bands."""


def surfaces(names: Sequence[str]) -> Callable[[Any, QgsProject], None]:
    """What makes one elevation layer a band of a raster that has just been loaded; ``names`` are the layers'.

    The loaded layer shows the first band; those of the others are put above it, as hidden or shown as it is.
    """

    def split(layer: QgsRasterLayer, project: QgsProject) -> None:
        node = project.layerTreeRoot().findLayer(layer.id())
        count = min(layer.bandCount(), len(names))
        for band in range(count, 0, -1):
            one = layer if band == 1 else layer.clone()
            one.setName(names[band - 1])
            _show_heights(one, band)
            if one is layer:
                continue
            added = project.addMapLayer(one, node is None)
            if node is not None:
                place = node.parent().children().index(node)
                beside = node.parent().insertLayer(place, added)
                beside.setItemVisibilityChecked(node.itemVisibilityChecked())
                beside.setExpanded(node.isExpanded())

    return split


def _show_heights(layer: QgsRasterLayer, band: int) -> None:
    """Relief of a band on the map, and its heights for profiles and 3D views."""
    provider = layer.dataProvider()
    layer.setRenderer(QgsHillshadeRenderer(provider, band, LIGHT_AZIMUTH_DEGREES, LIGHT_ANGLE_DEGREES))
    elevation = layer.elevationProperties()
    elevation.setEnabled(True)
    elevation.setBandNumber(band)
    elevation.setProfileSymbology(Qgis.ProfileSurfaceSymbology.Line)
    line = elevation.profileLineSymbol().clone()
    line.setColor(QColor(LINE_COLOURS[(band - 1) % len(LINE_COLOURS)]))
    elevation.setProfileLineSymbol(line)
    layer.triggerRepaint()
