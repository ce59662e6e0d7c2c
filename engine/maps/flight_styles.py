"""QGIS styles of a planned flight: its lines and waypoints."""

from __future__ import annotations

from pathlib import Path

from ..core.templates import render

_TEMPLATE = Path(__file__).parent / "styles" / "single_symbol.qml.j2"
_ORANGE, _WHITE = "217,107,30,255", "255,255,255,255"


def flight_lines_qml() -> str:
    """Orange lines."""
    options = {"line_color": _ORANGE, "line_width": "0.6", "line_width_unit": "MM"}
    return render(_TEMPLATE, kind="line", layer="SimpleLine", options=options)


def waypoints_qml() -> str:
    """Small white points with an orange rim."""
    options = {"name": "circle", "color": _WHITE, "outline_color": _ORANGE, "size": "1.8", "size_unit": "MM"}
    return render(_TEMPLATE, kind="marker", layer="SimpleMarker", options=options)
