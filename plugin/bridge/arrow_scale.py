"""How many times longer than in truth a layer's style draws its arrows, which the name of the layer says."""

from __future__ import annotations

import re
from typing import Any

from qgis.core import QgsSingleSymbolRenderer, QgsVectorLayer

from .words import tr

_MOTION = re.compile(r'([\d.]+) \* "east_m"')
_VELOCITY = re.compile(r'0\.001 \* ([\d.]+) \* "east_mm_day"')


def named_with_scale(layer: Any, title: str) -> str:
    """The title with the scale of the layer's arrows; the title alone where its style draws none."""
    for part in _symbol_layers(layer):
        geometry = part.properties().get("geometryModifier", "")
        motion, velocity = _MOTION.search(geometry), _VELOCITY.search(geometry)
        if velocity:
            return tr("{0} (arrows: motion of {1} days)").format(title, f"{float(velocity[1]):g}")
        if motion:
            return tr("{0} (arrows × {1})").format(title, f"{float(motion[1]):g}")
    return title


def _symbol_layers(layer: Any) -> list[Any]:
    renderer = layer.renderer() if isinstance(layer, QgsVectorLayer) else None
    symbol = renderer.symbol() if isinstance(renderer, QgsSingleSymbolRenderer) else None
    return [] if symbol is None else symbol.symbolLayers()
