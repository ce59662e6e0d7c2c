"""Flight lines as KML 2.3 (OGC 12-007r2), for a look in any earth viewer and for ground stations that read it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from pyproj import CRS, Transformer

from ..core.arrays import Float
from ..core.staged_outputs import atomic_output
from .lines import Line

_NAMESPACE = "http://www.opengis.net/kml/2.2"


def to_wgs84(xy: Float, crs: CRS) -> Float:
    """Longitudes and latitudes (n, 2), degrees, of places (n, 2+) in ``crs``."""
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
    transformer = Transformer.from_crs(horizontal, "EPSG:4326", always_xy=True)
    return np.column_stack(transformer.transform(xy[:, 0], xy[:, 1]))


def write_kml(path: Path, lines: list[Line], crs: CRS, name: str) -> None:
    """Write a folder of lines and one of waypoints, with absolute altitudes as the terrain's system counts them."""
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = ET.SubElement(root, "Document")
    ET.SubElement(document, "name").text = name
    style = ET.SubElement(document, "Style", id="line")
    drawn = ET.SubElement(style, "LineStyle")
    ET.SubElement(drawn, "color").text = "ff1e6bd9"
    ET.SubElement(drawn, "width").text = "3"
    for title, points in (("lines", False), ("waypoints", True)):
        folder = ET.SubElement(document, "Folder")
        ET.SubElement(folder, "name").text = title
        for line in lines:
            places = np.column_stack([to_wgs84(line.xyz, crs), line.xyz[:, 2]])
            if points:
                for number, place in enumerate(places, 1):
                    _placemark(folder, f"{line.number}-{number}", "Point", place[None])
            else:
                _placemark(folder, f"line {line.number}", "LineString", places)
    ET.indent(root)
    with atomic_output(path) as partial:
        ET.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


def _placemark(folder: ET.Element, name: str, kind: str, places: Float) -> None:
    mark = ET.SubElement(folder, "Placemark")
    ET.SubElement(mark, "name").text = name
    if kind == "LineString":
        ET.SubElement(mark, "styleUrl").text = "#line"
    shape = ET.SubElement(mark, kind)
    ET.SubElement(shape, "altitudeMode").text = "absolute"
    ET.SubElement(shape, "coordinates").text = " ".join(f"{x:.8f},{y:.8f},{z:.2f}" for x, y, z in places)
