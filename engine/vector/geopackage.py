"""GeoPackages of a run: one layer a table, its QGIS style inside, the same bytes for the same content."""

from __future__ import annotations

import sqlite3
import warnings
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import geopandas as gpd
import numpy as np
import pandas as pd
import pyogrio
import shapely
from pyproj.exceptions import CRSError

from ..core.errors import EngineError, InputError
from ..core.gdal_names import readable, writable
from ..core.staged_outputs import atomic_output
from .measured_columns import guard_table
from .review_fields import REVIEW_FIELDS

# Version 1.2 is what every GDAL since 2018 reads without a warning.
_OPTIONS = {"dataset_options": {"VERSION": "1.2", "DATETIME_FORMAT": "UTC"}, "layer_options": {"GEOMETRY_NAME": "geom"}}

# The table as QGIS itself makes it.
_STYLE_TABLE = """CREATE TABLE layer_styles (
    id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
    f_table_catalog TEXT(256), f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256),
    styleName TEXT(30), styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, owner TEXT(30),
    ui TEXT(30), update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))"""


READ_FAULTS = (OSError, RuntimeError, ValueError, CRSError, shapely.errors.ShapelyError)
"""What is raised where a vector file is none, is damaged, or holds shapes that cannot be."""


@dataclass(frozen=True)
class Layer:
    """A layer to write: its table, its ``name``, ``qml`` as its default style, ``geometry_type`` as declared.

    A plain table makes a layer without geometry. ``own`` are columns that people added, whose names may be any;
    a ``guarded`` layer lets nothing be edited but these and ``review_fields.REVIEW_FIELDS``.
    """

    frame: gpd.GeoDataFrame | pd.DataFrame
    name: str
    qml: str = ""
    geometry_type: str | None = None
    own: tuple[str, ...] = ()
    guarded: bool = False


def write_layer(
    path: Path, frame: gpd.GeoDataFrame, layer: str, *, geometry_type: str | None = None, stamp: date | None = None
) -> None:
    """Write ``frame`` as the only layer of a new GeoPackage, without a style.

    Args:
        geometry_type: as the layer declares it; needed where ``frame`` is empty.
        stamp: date that the file states as its last change, such as the later epoch's. Without it 1970-01-01, because
            the clock would make the bytes differ from run to run.

    Raises:
        EngineError: a field name is not lowercase or longer than 31 characters, or the file read back differs.
        InputError: the folder is missing or not writable.
    """
    write_layers(path, [Layer(frame, layer, geometry_type=geometry_type)], stamp=stamp)


def write_layers(path: Path, layers: Sequence[Layer], *, stamp: date | None = None) -> None:
    """As ``write_layer``, with several layers in one new GeoPackage."""
    fields = {layer.name: _fields(layer.frame) for layer in layers}
    for layer in layers:
        for name in fields[layer.name]:
            if name in layer.own:
                continue
            if name != name.lower() or len(name) > 31:
                raise EngineError(f"{name} is no field name for {Path(path).name}")

    def check(written: Path) -> None:
        with writable(written) as plain:
            for layer in layers:
                _check(plain, layer.frame, layer.name, fields[layer.name])

    moment = f"{(stamp or date(1970, 1, 1)).isoformat()}T00:00:00.000Z"
    with atomic_output(Path(path), check) as named, writable(named) as partial:
        partial.unlink(missing_ok=True)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="'crs' was not provided")
            for number, layer in enumerate(layers):
                pyogrio.write_dataframe(
                    layer.frame,
                    partial,
                    layer=layer.name,
                    driver="GPKG",
                    geometry_type=layer.geometry_type,
                    append=number > 0,
                    **_OPTIONS,
                )
        with closing(sqlite3.connect(partial)) as database, database:
            styled = [layer for layer in layers if layer.qml]
            if styled:
                _add_styles(database, styled, moment)
            for layer in layers:
                if layer.guarded:
                    guard_table(database, layer.name, (*REVIEW_FIELDS, *layer.own))
            database.execute("UPDATE gpkg_contents SET last_change = ?", (moment,))
        _reset_change_counter(partial)


def _fields(frame: pd.DataFrame) -> list[str]:
    geometry = frame.geometry.name if isinstance(frame, gpd.GeoDataFrame) else None
    return [name for name in frame.columns if name != geometry]


def _reset_change_counter(path: Path) -> None:
    """Set SQLite's count of a file's changes, and the count for which its version is valid, to 1.

    How many transactions GDAL writes a file in varies with its timing, and so would the bytes
    (https://www.sqlite.org/fileformat2.html, offsets 24 and 92).
    """
    with path.open("r+b") as file:
        for offset in (24, 92):
            file.seek(offset)
            file.write((1).to_bytes(4, "big"))


def read_layer(path: Path, layer: str | None = None) -> gpd.GeoDataFrame:
    """Read a layer of any vector file that GDAL knows.

    Raises:
        InputError: missing, not a vector file, or without that layer.
    """
    try:
        with readable(Path(path)) as plain:
            return pyogrio.read_dataframe(plain, layer=layer)
    except READ_FAULTS as error:
        wanted = f" with a layer {layer}" if layer else ""
        raise InputError(f"{path} cannot be read as a vector file{wanted}; give a GeoPackage.") from error


def has_shapes(frame: gpd.GeoDataFrame | pd.DataFrame) -> bool:
    """Whether a table as ``read_layer`` gives it has rows, and a shape of finite corners in each."""
    if not isinstance(frame, gpd.GeoDataFrame) or frame.empty:
        return False
    return not (frame.geometry.isna() | frame.geometry.is_empty).any() and bool(np.isfinite(frame.total_bounds).all())


def _add_styles(database: sqlite3.Connection, layers: Sequence[Layer], moment: str) -> None:
    database.execute(_STYLE_TABLE)
    for layer in layers:
        database.execute(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName,"
            " styleQML, styleSLD, useAsDefault, description, owner, update_time)"
            " VALUES ('', '', ?, 'geom', ?, ?, '', 1, '', '', ?)",
            (layer.name, "SlopeWatch", layer.qml, moment),
        )
    # known to the GeoPackage, else strict readers complain about a stray table
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, srs_id)"
        " VALUES ('layer_styles', 'attributes', 'layer_styles', '', 0)"
    )


def _check(written: Path, frame: pd.DataFrame, layer: str, fields: list[str]) -> None:
    info = pyogrio.read_info(written, layer=layer)
    with closing(sqlite3.connect(written)) as database:
        intact = database.execute("PRAGMA quick_check").fetchone()[0] == "ok"
    if not intact or info["features"] != len(frame) or list(info["fields"]) != fields:
        raise EngineError(f"{written.name} read back differs from what was written")
