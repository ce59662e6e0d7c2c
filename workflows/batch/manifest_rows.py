"""The rows of a manifest as texts by column, whatever it is: CSV, a layer of polygons, or a folder of folders."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
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
from ...engine.epochs.manifest import CLOUD_ENDINGS, read_table
from ...interface.dates import date_in_name

NEEDED = ("slope", "date", "file")
_ROI_ENDINGS = (".gpkg", ".geojson", ".shp", ".kml")
_VECTORS = (".gpkg", ".geojson", ".json", ".shp", ".fgb")


@dataclass(frozen=True)
class Row:
    """``place`` names the row in messages; ``values`` are stripped texts by column in small letters.

    ``polygon`` is the slope's region in ``crs`` where the manifest is a layer, ``path`` the cloud where its name
    need not be text. ``problem`` says what is wrong with it already.
    """

    place: str
    values: Mapping[str, str]
    polygon: BaseGeometry | None = None
    crs: CRS | None = None
    path: Path | None = None
    problem: str = ""


@dataclass(frozen=True)
class Table:
    """``folder`` is where relative paths start."""

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    folder: Path


def rows_of(source: Path) -> Table:
    """The rows of a manifest.

    Raises:
        InputError: it does not exist, cannot be read, holds no row, or lacks a column.
    """
    name = shown(source)
    if source.is_dir() and source.suffix.lower() != ".gdb":
        table = _folder_rows(source)
    elif not source.exists():
        raise InputError(f"The manifest {name} does not exist; give a CSV file, a GeoPackage or a folder.")
    elif source.suffix.lower() in CLOUD_ENDINGS:
        raise InputError(f"{name} is a cloud; give a manifest of the slopes (CSV, GeoPackage or a folder of folders).")
    elif source.suffix.lower() in _VECTORS:
        table = _layer_rows(source)
    else:
        table = _csv_rows(source)
    missing = [column for column in NEEDED if column not in table.columns]
    if missing:
        raise InputError(f"The manifest {name} has no column {missing[0]}; it needs {', '.join(NEEDED)} and roi.")
    if not table.rows:
        raise InputError(f"The manifest {name} holds no survey; give one row for each.")
    return table


def _csv_rows(source: Path) -> Table:
    lines = read_table(source, "manifest")
    if not lines:
        raise InputError(f"The manifest {shown(source)} is empty; give a line slope,date,file,roi and one a survey.")
    head = tuple(cell.strip().lower() for cell in lines[0][1])
    twice = sorted({column for column in head if column and head.count(column) > 1})
    if twice:
        raise InputError(f"The manifest {shown(source)} has the column {twice[0]} twice; remove one.")
    rows = []
    for number, cells in lines[1:]:
        values = dict(zip(head, (cell.strip() for cell in cells), strict=False))
        more = [cell for cell in cells[len(head) :] if cell.strip()]
        problem = f"it has {len(cells)} values for {len(head)} columns; quote texts with commas." if more else ""
        rows.append(Row(f"Line {number}", values, problem=problem))
    return Table(tuple(column for column in head if column), tuple(rows), source.parent)


def _layer_rows(source: Path) -> Table:
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
    return Table(tuple(named.values()), tuple(rows), source.parent)


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


def _folder_rows(source: Path) -> Table:
    """One slope a folder, with dated clouds; a single vector file named roi is its region."""
    rows = []
    folders = sorted(p for p in source.iterdir() if p.is_dir() and not p.name.startswith("."))
    if not folders:
        raise InputError(f"The folder {shown(source)} holds no folder; give each slope one, with its dated clouds.")
    for folder in folders:
        name = folder.name.encode("utf-8", "backslashreplace").decode()
        clouds = sorted(p for p in folder.iterdir() if p.is_file() and p.suffix.lower() in CLOUD_ENDINGS)
        place = f"Folder {shown(name)}"
        if not clouds:
            rows.append(Row(place, {"slope": name}, problem="it holds no LAS or LAZ file; give its surveys."))
        region = next((f for end in _ROI_ENDINGS for f in [folder / f"roi{end}"] if f.is_file()), None)
        for cloud in clouds:
            day = date_in_name(cloud)
            values = {"slope": name, "date": day.isoformat() if day else "", "roi": str(region or "")}
            problem = "" if day else f"the name of {shown(cloud.name)} does not hold exactly one date; rename it."
            rows.append(Row(place, values, path=cloud.absolute(), problem=problem))
    return Table((*NEEDED, "roi"), tuple(rows), source)
