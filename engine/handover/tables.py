"""Layers as GeoPackage, GeoJSON, KML and CSV."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import pyogrio
import shapely
from pyproj.exceptions import ProjError

from ..core import table_text
from ..core.arrays import Float
from ..core.errors import EngineError, InputError
from ..core.gdal_names import writable
from ..core.staged_outputs import atomic_output
from ..grid.geotiff import Raster
from ..vector.geopackage import Layer, write_layers
from .held import HeldLayer
from .surfaces import heights_at

DEGREE_DECIMALS = 7
"""Of degrees: about a centimetre."""
_METRE_DECIMALS = 3
_GLOBE = "EPSG:4326"
_NO_NUMBERS = {"nan", "inf", "infinity"}
_KINDS = {0: "Point", 1: "LineString", 3: "Polygon", 4: "MultiPoint", 5: "MultiLineString", 6: "MultiPolygon"}


def write_package(path: Path, layers: Sequence[HeldLayer], *, stamp: date | None) -> None:
    """All layers and tables in one GeoPackage, with their styles; to be edited by whoever gets it."""
    held = [
        Layer(layer.frame, layer.name, layer.qml, _declared(layer.frame), tuple(map(str, layer.frame.columns)))
        for layer in layers
    ]
    write_layers(path, held, stamp=stamp)


def _declared(frame: pd.DataFrame) -> str | None:
    """The kind of places that a layer declares: with parts, or heights, where any has some."""
    if not isinstance(frame, gpd.GeoDataFrame):
        return None
    shapes = frame.geometry.to_numpy()
    kinds = {kind for kind in shapely.get_type_id(shapes).tolist() if kind >= 0}
    if not kinds:
        return "MultiPolygon"
    most = max(kinds)
    kind = _KINDS.get(most, "Unknown") if kinds <= {most, most - 3} else "Unknown"
    return f"{kind} Z" if kind != "Unknown" and shapely.has_z(shapes).any() else kind


def on_the_globe(layer: HeldLayer) -> gpd.GeoDataFrame | None:
    """The layer's places seen from above in degrees (EPSG:4326, longitude first); None without places.

    Raises:
        InputError: it has no reference system, or lies where that does not hold.
    """
    frame = layer.places
    if frame is None:
        return None
    if frame.crs is None:
        raise InputError(
            f"The layer {layer.name} has no reference system, so no place on the globe; make the run again."
        )
    flat = frame.set_geometry(shapely.force_2d(frame.geometry.to_numpy()), crs=frame.crs)
    try:
        moved = flat.to_crs(_GLOBE)
    except ProjError as error:
        raise InputError(f"The layer {layer.name} has no place on the globe ({error}); check its system.") from error
    if not np.isfinite(shapely.get_coordinates(moved.geometry.to_numpy())).all():
        raise InputError(f"The layer {layer.name} lies outside of where its reference system holds; check its system.")
    return moved


def write_geojson(path: Path, layer: HeldLayer) -> None:
    """As RFC 7946 has it: degrees of 7 decimals, outer rings counterclockwise, no null island of a system inside."""
    frame = on_the_globe(layer)
    if frame is None:
        raise EngineError(f"{layer.name} has no places for {path.name}")
    options = {"RFC7946": "YES", "COORDINATE_PRECISION": str(DEGREE_DECIMALS), "WRITE_NAME": "NO"}
    with atomic_output(path, lambda written: _check_features(written, len(frame))) as named, writable(named) as plain:
        pyogrio.write_dataframe(frame, plain, driver="GeoJSON", layer_options=options)


def _check_features(path: Path, count: int) -> None:
    document = json.loads(path.read_text(encoding="utf-8"))
    if document.get("type") != "FeatureCollection" or len(document["features"]) != count:
        raise EngineError(f"{path.name} read back differs from what was written")


def write_kml(path: Path, layer: HeldLayer, surface: Raster | None = None) -> None:
    """A layer for a globe: on its ground, or with ``surface`` at the ground's heights (metres above the sea).

    The heights are those of the run: where these are above another level than the sea's, the file is off by as much.
    """
    frame = on_the_globe(layer)
    places = layer.places
    if frame is None or places is None:
        raise EngineError(f"{layer.name} has no places for {path.name}")
    if surface is not None:
        heights = heights_at(surface, shapely.get_coordinates(places.geometry.to_numpy()))
        frame = frame.set_geometry(_with_heights(frame.geometry.to_numpy(), heights), crs=frame.crs)
        frame["altitudeMode"] = "absolute"
    title = _title_field(frame)
    if title:
        frame = frame.rename(columns={title: "Name"})
    with atomic_output(path, lambda written: _check_count(written, len(frame))) as named, writable(named) as plain:
        pyogrio.write_dataframe(_texts(frame), plain, driver="LIBKML", layer=layer.name)


def _with_heights(shapes: Any, heights: Float) -> Any:
    xy = shapely.get_coordinates(shapes)
    return shapely.set_coordinates(shapely.force_3d(shapes), np.column_stack([xy, heights]))


def _title_field(frame: gpd.GeoDataFrame) -> str:
    """The field that names a feature; empty where none does."""
    if "Name" in frame:
        return ""
    return next((name for name in frame.columns if name.lower() in ("zone_id", "name", "slope")), "")


def _texts(frame: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """Missing texts are empty: the driver would write the word for what is missing."""
    filled = frame.copy()
    for name in filled.columns:
        if name != filled.geometry.name and not pd.api.types.is_numeric_dtype(filled[name]):
            filled[name] = filled[name].astype(object).where(filled[name].notna(), "").astype(str)
    return filled


def _check_count(path: Path, count: int) -> None:
    if pyogrio.read_info(path)["features"] != count:
        raise EngineError(f"{path.name} read back differs from what was written")


def write_csv(path: Path, layer: HeldLayer) -> None:
    """A table in UTF-8: with places, a point of each in degrees and metres, and its outline as text (WKT)."""
    frame = pd.DataFrame(layer.frame.drop(columns=_geometry_names(layer.frame)))
    for name in frame.columns:
        if not pd.api.types.is_numeric_dtype(frame[name]):
            texts = frame[name].astype(object).where(frame[name].notna(), "")
            frame[name] = [table_text.cell(str(value)) for value in texts]
    frame = frame.rename(columns=table_text.cell)
    globe, places = on_the_globe(layer), layer.places
    if globe is not None and places is not None:
        shapes = shapely.force_2d(places.geometry.to_numpy())
        inner = shapely.point_on_surface(shapes)
        # within the shape in metres, then moved: in degrees another point would be taken
        spots = gpd.GeoSeries(inner, crs=places.crs).to_crs(_GLOBE)
        frame["lon_deg"], frame["lat_deg"] = spots.x.round(DEGREE_DECIMALS), spots.y.round(DEGREE_DECIMALS)
        frame["x_m"], frame["y_m"] = (np.round(read(inner), _METRE_DECIMALS) for read in (shapely.get_x, shapely.get_y))
        frame["wkt"] = shapely.to_wkt(shapes, rounding_precision=_METRE_DECIMALS, trim=True)
    with atomic_output(path) as partial:
        frame.to_csv(partial, index=False, encoding="utf-8", lineterminator="\n")


def _geometry_names(frame: pd.DataFrame) -> list[str]:
    return [frame.geometry.name] if isinstance(frame, gpd.GeoDataFrame) else []


def copy_table(source: Path, target: Path) -> None:
    """A CSV file of the run as it is; cells that say that a number is none become empty."""
    try:
        with source.open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.reader(stream))
    except (UnicodeDecodeError, csv.Error):
        rows = []
    if not any(_is_no_number(cell) for row in rows for cell in row):
        shutil.copyfile(source, target)
        return
    with target.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerows([["" if _is_no_number(cell) else cell for cell in row] for row in rows])


def _is_no_number(cell: str) -> bool:
    return cell.strip().lower().lstrip("+-") in _NO_NUMBERS
