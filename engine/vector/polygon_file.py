"""Polygons with attributes from a vector file that people made."""

from __future__ import annotations

from pathlib import Path

import geopandas
import pyogrio
import shapely

from ..core.errors import InputError
from ..core.gdal_names import readable
from ..core.messages import shown
from .crossings import refuse_tangled
from .geopackage import READ_FAULTS


def read_polygons(path: Path, field: str, option: str) -> tuple[geopandas.GeoDataFrame, str]:
    """The first layer of a vector file that has polygons, and the name that the wanted field has there.

    The polygons are made valid and two-dimensional. Rows without a shape stay, for their attributes.

    Args:
        field: as somebody names it; the letters' case counts only where two names differ in nothing else.
        option: which names the field, for the message; empty if the field has one name only.

    Raises:
        InputError: missing, not a vector file, or without polygons or the field.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"The polygons {shown(path)} do not exist; check their path.")
    try:
        with readable(path) as plain:
            layers = [str(layer) for layer, kind in pyogrio.list_layers(plain) if "Polygon" in str(kind)]
            if not layers:
                raise InputError(f"{shown(path)} holds no polygons; give a layer of polygons with the field {field}.")
            frame = pyogrio.read_dataframe(plain, layer=layers[0], force_2d=True)
    except READ_FAULTS as error:
        raise InputError(
            f"The polygons {shown(path)} cannot be read; give them as GeoPackage, shapefile or GeoJSON."
        ) from error
    columns = [str(column) for column in frame.columns if column != frame.geometry.name]
    found = [c for c in columns if c == field] or [c for c in columns if c.lower() == field.lower()]
    if not found:
        remedy = f"name the one to take by {option}" if option else "add it"
        raise InputError(
            f"The polygons {shown(path)} have no field {field}; {remedy} (there are {', '.join(columns) or 'none'})."
        )
    refuse_tangled(frame.geometry, f"The layer {shown(path)}")
    return frame.set_geometry(shapely.make_valid(frame.geometry.to_numpy()), crs=frame.crs), found[0]
