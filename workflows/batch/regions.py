"""Folders and files of slopes: names that are safe on every system, and the polygons of a layer as files."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import geopandas as gpd
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ...engine.vector.geopackage import write_layer

_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_LONGEST = 48  # letters: a result's path must fit where paths are short


def folder_name(slope: str) -> str:
    """A folder's name for a slope: its own where every system takes that, else a likeness with part of its hash."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", slope).strip("._-")[:_LONGEST]
    if plain == slope and not _RESERVED.fullmatch(plain):
        return plain
    return f"{plain or 'slope'}-{hashlib.sha256(slope.encode()).hexdigest()[:8]}"


def write_region(folder: Path, slope: str, shape: BaseGeometry, crs: CRS | None) -> Path:
    """Write the polygon of a slope, unless it is there already; its path is named by its content."""
    parts = shapely.MultiPolygon([p for p in shapely.get_parts(shape) if p.geom_type == "Polygon"])
    content = parts.wkb + (b"" if crs is None else crs.to_wkt().encode())
    path = folder / f"{folder_name(slope)}_{hashlib.sha256(content).hexdigest()[:8]}.gpkg"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_layer(path, gpd.GeoDataFrame({"slope": [slope]}, geometry=[parts], crs=crs), "roi")
    return path
