"""Areas given as vector files: read, repaired and brought into the clouds' reference system."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from pyogrio.raw import read as read_raw
from pyproj import CRS
from shapely.geometry import MultiPolygon, Polygon

from ..core.errors import InputError
from ..core.gdal_names import readable
from ..core.messages import shown
from ..crs.reprojection import reprojected
from .crossings import refuse_tangled
from .geopackage import READ_FAULTS

Bounds = tuple[float, float, float, float]

_MAX_COORDINATE = 1e9
"""In any unit: more is no place on the earth, and overflows when areas are computed."""


@dataclass(frozen=True)
class Roi:
    """``geometry`` is a valid polygon in metres of the clouds' reference system; ``notes`` are sentences."""

    geometry: Polygon | MultiPolygon
    path: Path
    notes: tuple[str, ...] = ()

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north."""
        west, south, east, north = self.geometry.bounds
        return west, south, east, north

    @property
    def area(self) -> float:
        """Square metres."""
        return float(self.geometry.area)


def read_roi(path: Path | str, crs: CRS, *, unit: float = 1.0) -> Roi:
    """The union of the polygons in the first polygon layer of a vector file.

    Args:
        path: anything that GDAL reads (GeoPackage, shapefile, GeoJSON, KML, ...).
        crs: the clouds' reference system in metres, see ``crs.working_frame``.
        unit: metres of the cloud file's own horizontal unit, in which an area that declares nothing is taken to be.

    Raises:
        InputError: missing, not a vector file, without polygons, or not transformable.
    """
    path = Path(path)
    name = shown(path)
    if not path.exists():
        raise InputError(f"The area {name} does not exist; check its path.")
    notes: list[str] = []
    try:
        with readable(path) as plain:
            layer = _polygon_layer(plain, name, notes)
            meta, _, wkb, _ = read_raw(plain, layer=layer, columns=[], force_2d=True)
    except READ_FAULTS as error:
        raise InputError(
            f"The area {name} cannot be read as a vector file; give polygons as GeoPackage, shapefile, GeoJSON or KML."
        ) from error
    polygons = _polygons(wkb, name, notes)
    refuse_tangled(polygons, f"The area {name}")
    polygons = _repaired(polygons, name, notes)
    polygons = _transformed(polygons, meta.get("crs"), crs, unit, name, notes)
    merged = shapely.union_all(_repaired(polygons, name, []))
    if not isinstance(merged, (Polygon, MultiPolygon)) or not merged.area > 0:
        raise InputError(f"The area {name} has no extent; draw a polygon around the area of interest.")
    if len(polygons) > 1:
        notes.append(f"The area {name} has {len(polygons)} polygons, which are taken together.")
    return Roi(merged, path, tuple(notes))


def refuse_outside(roi: Roi, bounds: Bounds, cloud: Path | str) -> None:
    """Raise InputError, with both extents, if no part of the area lies within ``bounds`` (west, south, east, north)."""
    if not roi.geometry.intersects(shapely.box(*bounds)):
        raise InputError(
            f"The area {shown(roi.path)} ({_extent(roi.bounds)}) lies outside of the cloud {shown(cloud)} "
            f"({_extent(bounds)}); check the area and the reference systems of both."
        )


def _polygon_layer(path: Path, name: str, notes: list[str]) -> str:
    """The first layer of polygons, or the first that does not declare what it holds."""
    # the styles that QGIS keeps in a GeoPackage are none of its layers
    layers = [(str(layer), str(kind)) for layer, kind in pyogrio.list_layers(path) if layer != "layer_styles"]
    for wanted in (("Polygon", "Surface"), ("Unknown", "Collection")):
        for layer, kind in layers:
            if any(word in kind for word in wanted):
                if len(layers) > 1:
                    notes.append(f"The area {name} has {len(layers)} layers; its layer {layer} is used.")
                return layer
    kinds = ", ".join(sorted({kind for _, kind in layers if kind != "None"})) or "no geometry"
    raise InputError(f"The area {name} holds no polygons ({kinds}); draw a polygon around the area of interest.")


def _polygons(wkb: np.ndarray, name: str, notes: list[str]) -> list[Polygon]:
    try:
        geometries = shapely.from_wkb(wkb)
    except shapely.errors.GEOSException as error:
        raise InputError(f"The area {name} has a geometry that cannot be read; save it again as polygons.") from error
    parts = shapely.get_parts(shapely.get_parts(geometries))  # twice: a collection may hold multipolygons
    parts = parts[~shapely.is_missing(parts) & ~shapely.is_empty(parts)]
    polygons = [part for part in parts if isinstance(part, Polygon)]
    if not polygons:
        kinds = ", ".join(sorted({part.geom_type for part in parts})) or "no geometry"
        raise InputError(f"The area {name} holds no polygons ({kinds}); draw a polygon around the area of interest.")
    if len(polygons) < len(parts):
        notes.append(f"The area {name} has {len(parts) - len(polygons)} lines or points, which are left out.")
    with np.errstate(invalid="ignore"):
        if not (np.abs(shapely.get_coordinates(polygons)) <= _MAX_COORDINATE).all():
            raise InputError(f"The area {name} has a corner that is not a number, or lies nowhere; draw it again.")
    return polygons


def _repaired(polygons: list[Polygon], name: str, notes: list[str]) -> list[Polygon]:
    """Valid polygons; self-intersecting ones are split where they cross themselves."""
    valid = shapely.is_valid(polygons)
    if valid.all():
        return polygons
    notes.append(f"The area {name} has a polygon that crosses itself; it was repaired, so check its outline.")
    parts = shapely.get_parts(shapely.get_parts(shapely.make_valid(polygons)))
    return [part for part in parts if isinstance(part, Polygon) and part.area > 0]


def _transformed(
    polygons: list[Polygon], declared: str | None, crs: CRS, unit: float, name: str, notes: list[str]
) -> list[Polygon]:
    if not declared:
        notes.append(f"The area {name} declares no reference system; that of the cloud ({crs.name}) is assumed.")
        return polygons if unit == 1.0 else list(shapely.transform(polygons, lambda xy: xy * unit))
    return list(reprojected(polygons, declared, crs, f"The area {name}", notes))


def _extent(bounds: Bounds) -> str:
    west, south, east, north = bounds
    return f"x {west:.1f} to {east:.1f}, y {south:.1f} to {north:.1f}"
