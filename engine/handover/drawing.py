"""Zones, lines, vectors, sections and ground as a drawing (DXF of AutoCAD 2010, in metres)."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pandas as pd
import pyogrio
import shapely
from ezdxf import units
from ezdxf.document import Drawing
from ezdxf.layouts import Modelspace

from ..core.arrays import Float
from ..core.errors import EngineError
from ..core.staged_outputs import atomic_output
from ..grid.geotiff import Raster
from .held import Held, HeldLayer, stretches
from .surfaces import Mesh, heights_at

_APPLICATION = "SLOPEWATCH"
_RED, _BLUE, _GREY, _GREEN, _BROWN, _MAGENTA = 1, 5, 8, 3, 34, 6
"""Colours of AutoCAD's index."""
_KIND_COLOURS = {"subsidence": _RED, "uplift": _BLUE}
_TEXT_SHARE, _MIN_TEXT_M, _MAX_TEXT_M = 0.012, 0.2, 5.0
"""Height of texts: a share of the drawing's larger side, and its bounds."""
_MAX_TEXT_CHARACTERS = 250
"""Of a text within the data of an object; DXF allows 255 bytes."""
_ATTRIBUTES = ("zone_id", "kind", "severity", "alert", "confidence", "dz_mean_m", "dz_p95_m", "area_m2", "vol_net_m3",
               "vol_err_m3", "rate_mm_day", "epoch_from", "epoch_to", "length_m", "length_err_m", "azimuth_deg",
               "route", "chain_from", "chain_to", "side")  # fmt: skip
"""Fields that outlines carry with them."""


def write_dxf(path: Path, held: Held, meshes: Mapping[str, Mesh], names: Mapping[str, str]) -> int:
    """Write the drawing; how many objects it has.

    Zones and footprints are outlines on the later ground, with their names and main fields as data of the application
    SLOPEWATCH; sections are lines in the heights of each survey, the ground is triangles (3DFACE).

    Args:
        meshes: the ground by name.
        names: other names of fields, see ``renamed_layers``.
    """
    ezdxf.options.write_fixed_meta_data_for_testing = True  # no clock and no random number: the same bytes each time
    drawing = ezdxf.new("R2010", setup=False, units=units.M)
    drawing.appids.add(_APPLICATION)
    space = drawing.modelspace()
    for name, mesh in meshes.items():  # first, so that all else is drawn over it
        drawn = _layer(drawing, name.upper().replace(" ", "_"), _GREY)
        for a, b, c in mesh.points[mesh.faces].tolist():
            space.add_3dface((a, b, c), dxfattribs={"layer": drawn})
    surface = list(held.surfaces.values())[-1] if held.surfaces else None
    for layer in held.layers:
        if layer.places is not None and len(layer.frame):
            _add_layer(drawing, space, layer, surface, names)
    for section in held.sections:
        for name, heights in (("SECTIONS_EARLIER", section.earlier), ("SECTIONS_LATER", section.later)):
            _layer(drawing, name, _BROWN if name.endswith("EARLIER") else _GREEN)
            _add_section(space, name, section.xy, heights)
    count = len(space)
    for kind in sorted(drawing.entitydb.dxf_types_in_use()):  # else in the order of a set, which each process has anew
        drawing.classes.add_class(kind)
    with atomic_output(path, lambda written: _check(written, count)) as partial:
        drawing.saveas(partial, encoding="utf-8")
    return count


def _check(path: Path, count: int) -> None:
    # by GDAL, another reader than the writer's
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Non closed ring")  # of its own rings of triangles
        found = pyogrio.read_info(path, force_feature_count=True)["features"]
    if found != count:
        raise EngineError(f"{path.name} read back differs from what was written")


def _layer(drawing: Drawing, name: str, colour: int) -> str:
    if not drawing.layers.has_entry(name):
        drawing.layers.add(name, color=colour)
    return name


def _add_layer(
    drawing: Drawing, space: Modelspace, layer: HeldLayer, surface: Raster | None, names: Mapping[str, str]
) -> None:
    height = _text_height(layer)
    kind_field = names.get(f"{layer.name}.kind", names.get("kind", "kind"))
    for row, shape in _rows(layer):
        kind = str(row.get(kind_field, ""))
        name = layer.name.upper() + (f"_{kind.upper()}" if kind in _KIND_COLOURS else "")
        attributes = {"layer": _layer(drawing, name, _KIND_COLOURS.get(kind, _MAGENTA))}
        data = _data(row, layer.name, names)
        for ring in _lines(shape):
            outline = space.add_polyline3d(_lifted(ring, surface), dxfattribs=attributes)
            outline.set_xdata(_APPLICATION, data)
        if shapely.get_dimensions(shape) == 0:
            _add_vector(space, row, shape, surface, attributes, names)
        title = next((str(row[f]) for f in _titles(names, layer.name) if f in row), "")
        if title and layer.name.endswith("zones"):
            _layer(drawing, f"{layer.name.upper()}_NAMES", 7)
            spot = shapely.get_coordinates(shapely.point_on_surface(shape))
            text = space.add_text(title, height=height, dxfattribs={"layer": f"{layer.name.upper()}_NAMES"})
            text.set_placement(tuple(_lifted(spot, surface)[0]))


def _rows(layer: HeldLayer) -> Iterator[tuple[dict[str, Any], Any]]:
    frame = layer.places
    if frame is not None:
        table = pd.DataFrame(frame.drop(columns=frame.geometry.name)).to_dict("records")
        yield from (
            (row, shape) for row, shape in zip(table, frame.geometry.to_numpy(), strict=True) if shape is not None
        )


def _titles(names: Mapping[str, str], layer: str) -> list[str]:
    return [names.get(f"{layer}.{field}", names.get(field, field)) for field in ("zone_id", "name", "slope")]


def _text_height(layer: HeldLayer) -> float:
    west, south, east, north = layer.frame.total_bounds
    return float(np.clip(_TEXT_SHARE * max(east - west, north - south), _MIN_TEXT_M, _MAX_TEXT_M))


def _data(row: Mapping[str, Any], layer: str, names: Mapping[str, str]) -> list[tuple[int, Any]]:
    """Main fields as ``name=value`` texts, under the names that were agreed on."""
    fields = [names.get(f"{layer}.{field}", names.get(field, field)) for field in _ATTRIBUTES]
    known = {field: row[field] for field in fields if field in row and not pd.isna(row[field]) and row[field] != ""}
    return [(1000, f"{field}={value}"[:_MAX_TEXT_CHARACTERS].replace("\n", " ")) for field, value in known.items()]


def _lines(shape: Any) -> Sequence[Float]:
    """Coordinates (n, 2) of all rings or lines of a shape."""
    parts = shapely.get_parts(shape)
    rings = [ring for part in parts for ring in (shapely.get_rings(part) if part.geom_type == "Polygon" else [part])]
    return [shapely.get_coordinates(ring) for ring in rings if ring.geom_type in ("LinearRing", "LineString")]


def _lifted(xy: Float, surface: Raster | None) -> Float:
    """Points (n, 3) on the surface; at 0 without one."""
    heights = np.zeros(len(xy)) if surface is None else heights_at(surface, xy)
    return np.column_stack([xy, heights])


def _add_section(space: Modelspace, layer: str, xy: Float, heights: Float) -> None:
    for part in stretches(heights):  # nothing is drawn over a gap
        space.add_polyline3d(np.column_stack([xy, heights])[part], dxfattribs={"layer": layer})


def _add_vector(
    space: Modelspace,
    row: Mapping[str, Any],
    place: Any,
    surface: Raster | None,
    attributes: Mapping[str, Any],
    names: Mapping[str, str],
) -> None:
    """A displacement as a line of its true length, other points as points."""
    start = _lifted(shapely.get_coordinates(place), surface)[0]
    fields = [names.get(field, field) for field in ("east_m", "north_m", "up_m")]
    if all(field in row for field in fields):
        line = space.add_line(start, start + [float(row[f]) for f in fields], dxfattribs=attributes)
        line.set_xdata(_APPLICATION, _data(row, "vectors", names))
    else:
        space.add_point(start, dxfattribs=attributes)
