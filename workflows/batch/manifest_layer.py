"""The rows of a manifest that is a layer of polygons: each is a slope's region."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import geopandas as gpd
import pandas as pd
import pyogrio
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ...engine.core.errors import InputError
from ...engine.core.gdal_names import readable
from ...engine.core.messages import shown
from .manifest_table import Row, Table
from .regions import write_region


def layer_rows(source: Path) -> Table:
    """The rows of a layer of polygons.

    Raises:
        InputError: it cannot be read.
    """
    try:
        with readable(source) as plain:
            layer = _polygon_layer(plain, source)
            frame = pyogrio.read_dataframe(plain, layer=layer, force_2d=True)
    except (OSError, RuntimeError, ValueError, sqlite3.Error, shapely.errors.ShapelyError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"The manifest {shown(source)} cannot be read as a vector file; give polygons with slope, date and file."
        ) from error
    if not isinstance(frame, gpd.GeoDataFrame):
        frame = gpd.GeoDataFrame(frame, geometry=[None] * len(frame))
    named = {str(c): str(c).strip().lower() for c in frame.columns if c != frame.geometry.name}
    crs = None if frame.crs is None else CRS.from_user_input(frame.crs)
    rows = []
    for number, (record, shape) in enumerate(
        zip(frame[list(named)].to_dict("records"), frame.geometry, strict=True), 1
    ):
        values = {named[str(column)]: _text(value) for column, value in record.items()}
        rows.append(_layer_row(f"Feature {number}", values, shape, crs))
    return Table(tuple(named.values()), tuple(rows), source.parent, _write)


def _layer_row(place: str, values: dict[str, str], shape: BaseGeometry | None, crs: CRS | None) -> Row:
    if shape is None or shape.is_empty:
        return Row(place, values)
    if shape.geom_type not in ("Polygon", "MultiPolygon"):
        return Row(place, values, problem=f"its shape is a {shape.geom_type}; draw the slope as a polygon.")
    shape = shape if shape.is_valid else shape.buffer(0)
    if shape.is_empty:
        return Row(place, values, problem="its polygon has no extent; draw it again.")
    return Row(place, values, shape, crs)


def _polygon_layer(plain: Path, source: Path) -> str:
    """The first layer of polygons, or the first table where there is none."""
    layers = [(str(layer), str(kind)) for layer, kind in pyogrio.list_layers(plain)]
    for layer, kind in layers:
        if "Polygon" in kind or "Surface" in kind:
            return layer
    if not layers:
        raise InputError(f"The manifest {shown(source)} holds no layer; give polygons with slope, date and file.")
    return layers[0][0]


def _text(value: Any) -> str:
    if value is None or (not isinstance(value, str) and bool(pd.isna(value))):
        return ""
    if hasattr(value, "isoformat"):
        return str(value.isoformat())[:10]
    if isinstance(value, float) and value.is_integer():
        return str(int(value))  # whole numbers of a column with gaps
    return str(value).strip()


def _write(folder: Path, slope: str, rows: Sequence[Row]) -> Path | None:
    shapes = [row.polygon for row in rows if row.polygon is not None]
    return write_region(folder, slope, shapely.union_all(shapes), rows[0].crs) if shapes else None
