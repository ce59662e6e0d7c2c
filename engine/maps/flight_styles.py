"""QGIS styles of a planned flight: its lines and waypoints."""

from __future__ import annotations

_LINE = (
    '<layer class="{kind}" enabled="1" locked="0" pass="0"><Option type="Map">{options}</Option></layer>'
)
_OPTION = '<Option name="{name}" type="QString" value="{value}"/>'
_QML = (
    '<!DOCTYPE qgis PUBLIC "http://mrcc.com/qgis.dtd" "SYSTEM">\n<qgis version="3.28" styleCategories="Symbology">'
    '<renderer-v2 type="singleSymbol" symbollevels="0" enableorderby="0" forceraster="0"><symbols>'
    '<symbol name="0" type="{type}" alpha="1" clip_to_extent="1" force_rhr="0">{layer}</symbol>'
    "</symbols></renderer-v2></qgis>\n"
)


def flight_lines_qml() -> str:
    """Orange lines."""
    return _qml("line", "SimpleLine", line_color="217,107,30,255", line_width="0.6", line_width_unit="MM")


def waypoints_qml() -> str:
    """Small white points with an orange rim."""
    return _qml(
        "marker",
        "SimpleMarker",
        name="circle",
        color="255,255,255,255",
        outline_color="217,107,30,255",
        size="1.8",
        size_unit="MM",
    )


def _qml(kind: str, layer: str, **options: str) -> str:
    text = "".join(_OPTION.format(name=name, value=value) for name, value in options.items())
    return _QML.format(type=kind, layer=_LINE.format(kind=layer, options=text))
