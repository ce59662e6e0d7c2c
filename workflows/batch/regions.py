"""The polygons of a layer as files, one a slope."""

from __future__ import annotations

import hashlib
from pathlib import Path

import geopandas as gpd
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ...engine.vector.geopackage import write_layer
from .folder_names import folder_name


def write_region(folder: Path, slope: str, shape: BaseGeometry, crs: CRS | None) -> Path:
    """Write the polygon of a slope, unless it is there already; its path is named by its content."""
    parts = shapely.MultiPolygon([p for p in shapely.get_parts(shape) if p.geom_type == "Polygon"])
    content = parts.wkb + (b"" if crs is None else crs.to_wkt().encode())
    path = folder / f"{folder_name(slope)}_{hashlib.sha256(content).hexdigest()[:8]}.gpkg"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_layer(path, gpd.GeoDataFrame({"slope": [slope]}, geometry=[parts], crs=crs), "roi")
    return path
