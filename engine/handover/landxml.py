"""Ground, sections and zones for road design: LandXML 1.2 (http://www.landxml.org/schema/LandXML-1.2), in metres.

LandXML gives places as northing, easting and elevation. A section is an alignment along its line with the profile of
each survey; a zone is a plan feature of closed lines with its fields as properties.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pandas as pd
import shapely
from pyproj import CRS

from ..core.arrays import Float
from ..core.errors import EngineError
from ..core.staged_outputs import atomic_output
from ..core.version import VERSION
from .held import Held, HeldLayer, Section, stretches
from .surfaces import Mesh

NAMESPACE = "http://www.landxml.org/schema/LandXML-1.2"
_SCHEMA = f"{NAMESPACE} {NAMESPACE}/LandXML-1.2.xsd"
_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
_UNITS = {
    "areaUnit": "squareMeter", "linearUnit": "meter", "volumeUnit": "cubicMeter", "temperatureUnit": "celsius",
    "pressureUnit": "milliBars", "angularUnit": "decimal degrees", "directionUnit": "decimal degrees",
}  # fmt: skip


def write_landxml(path: Path, held: Held, meshes: Mapping[str, Mesh], title: str) -> None:
    """Write the document; ``meshes`` are the ground by name, of which those without a triangle are left out."""
    meshes = {name: mesh for name, mesh in meshes.items() if len(mesh.faces)}
    root = Element(f"{{{NAMESPACE}}}LandXML", _heading(held))
    SubElement(SubElement(root, _tag("Units")), _tag("Metric"), _UNITS)
    if held.crs is not None:
        SubElement(root, _tag("CoordinateSystem"), _system(held.crs))
    SubElement(root, _tag("Project"), name=title)
    SubElement(root, _tag("Application"), name="SlopeWatch", version=VERSION)
    if meshes:
        surfaces = SubElement(root, _tag("Surfaces"))
        for name, mesh in meshes.items():
            _add_surface(surfaces, name, mesh)
    if held.sections:
        alignments = SubElement(root, _tag("Alignments"), name="sections")
        for section in held.sections:
            _add_section(alignments, section)
    for layer in held.zones:
        if len(layer.frame):
            _add_zones(SubElement(root, _tag("PlanFeatures"), name=layer.name), layer)
    ElementTree.register_namespace("", NAMESPACE)
    ElementTree.register_namespace("xsi", _INSTANCE)
    ElementTree.indent(root)
    with atomic_output(path, lambda written: _check(written, meshes)) as partial:
        ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


def _check(path: Path, meshes: Mapping[str, Mesh]) -> None:
    found = {
        surface.get("name"): len(surface.findall(f".//{_tag('F')}"))
        for surface in ElementTree.parse(path).getroot().iter(_tag("Surface"))
    }
    if found != {name: len(mesh.faces) for name, mesh in meshes.items()}:
        raise EngineError(f"{path.name} read back differs from what was written")


def _tag(name: str) -> str:
    return f"{{{NAMESPACE}}}{name}"


def _heading(held: Held) -> dict[str, str]:
    # the day of the last survey, not of the export: the same folder gives the same bytes
    day = held.days[-1].isoformat() if held.days else "1970-01-01"
    return {
        "version": "1.2", "date": day, "time": "00:00:00", "readOnly": "false", "language": "English",
        f"{{{_INSTANCE}}}schemaLocation": _SCHEMA,
    }  # fmt: skip


def _system(crs: CRS) -> dict[str, str]:
    found = {"name": crs.name, "desc": crs.name}
    parts = crs.sub_crs_list if crs.is_compound else [crs]
    code = parts[0].to_epsg()
    if code is not None:
        found["epsgCode"] = str(code)
    if len(parts) > 1:
        found["verticalDatum"] = parts[1].name
    return found


def _add_surface(parent: Element, name: str, mesh: Mesh) -> None:
    surface = SubElement(parent, _tag("Surface"), name=name, desc=f"triangles every {mesh.step_m:g} m")
    low, high = (float(reach(mesh.points[:, 2])) if len(mesh.points) else 0.0 for reach in (np.min, np.max))
    definition = SubElement(surface, _tag("Definition"), surfType="TIN", elevMin=f"{low:.3f}", elevMax=f"{high:.3f}")
    points = SubElement(definition, _tag("Pnts"))
    for number, (east, north, height) in enumerate(mesh.points.tolist(), 1):
        SubElement(points, _tag("P"), id=str(number)).text = f"{north:.3f} {east:.3f} {height:.3f}"
    faces = SubElement(definition, _tag("Faces"))
    for a, b, c in (mesh.faces + 1).tolist():
        SubElement(faces, _tag("F")).text = f"{a} {b} {c}"


def _add_section(parent: Element, section: Section) -> None:
    start, length = float(section.distance[0]), float(section.distance[-1] - section.distance[0])
    alignment = SubElement(
        parent, _tag("Alignment"), name=section.name, length=f"{length:.3f}", staStart=f"{start:.3f}"
    )
    _add_lines(SubElement(alignment, _tag("CoordGeom")), section.bends)
    profile = SubElement(alignment, _tag("Profile"), name=section.name)
    for name, heights in (("earlier", section.earlier), ("later", section.later)):
        known = stretches(heights)
        drawn = SubElement(profile, _tag("ProfSurf"), name=name) if known else profile
        for part in known:  # a list each, as the schema has it for gaps
            pairs = np.column_stack([section.distance, heights])[part].tolist()
            SubElement(drawn, _tag("PntList2D")).text = " ".join(
                f"{station:.3f} {height:.3f}" for station, height in pairs
            )


def _add_zones(parent: Element, layer: HeldLayer) -> None:
    frame = layer.places
    if frame is None:
        return
    fields = pd.DataFrame(frame.drop(columns=frame.geometry.name))
    title = next((name for name in fields.columns if name.lower().endswith("id")), fields.columns[0])
    for row, shape in zip(fields.to_dict("records"), frame.geometry.to_numpy(), strict=True):
        feature = SubElement(parent, _tag("PlanFeature"), name=str(row[title]))
        for ring in shapely.get_rings(shapely.get_parts(shape)):
            _add_lines(SubElement(feature, _tag("CoordGeom")), shapely.get_coordinates(ring))
        properties = SubElement(feature, _tag("Feature"), code=layer.name)
        for name, value in row.items():
            if not pd.isna(value) and value != "":
                SubElement(properties, _tag("Property"), label=str(name), value=_plain(value))


def _plain(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _add_lines(parent: Element, xy: Float) -> None:
    """Straight lines from corner to corner."""
    for (from_east, from_north), (to_east, to_north) in zip(xy[:-1].tolist(), xy[1:].tolist(), strict=True):
        line = SubElement(parent, _tag("Line"))
        SubElement(line, _tag("Start")).text = f"{from_north:.3f} {from_east:.3f}"
        SubElement(line, _tag("End")).text = f"{to_north:.3f} {to_east:.3f}"
