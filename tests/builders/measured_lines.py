"""Layers of lines with M values, whose bytes are put together here: pyogrio writes none."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import geopandas
import numpy as np
import shapely

_SHAPE_POLYLINE_M = 23


def write_measured_gpkg(path: Path, lines: Sequence[np.ndarray], crs: str = "EPSG:32651", **fields: Sequence) -> Path:
    """A GeoPackage of LineStringZM, corners (k, 4) as x, y, z, m."""
    flat = [shapely.LineString(line[:, :3]) for line in lines]
    geopandas.GeoDataFrame(fields, geometry=flat, crs=crs).to_file(path, layer="road", engine="pyogrio")
    with closing(sqlite3.connect(path)) as database, database:
        for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            database.execute(f'DROP TRIGGER "{name}"')
        database.execute("UPDATE gpkg_geometry_columns SET m = 1")
        for number, line in enumerate(lines, 1):
            (blob,) = database.execute("SELECT geom FROM road WHERE fid = ?", (number,)).fetchone()
            header = blob[: 8 + {0: 0, 1: 32, 2: 48}[(blob[3] >> 1) & 7]]
            wkb = struct.pack("<BII", 1, 3002, len(line)) + np.ascontiguousarray(line, "<f8").tobytes()
            database.execute("UPDATE road SET geom = ? WHERE fid = ?", (header + wkb, number))
    return path


def write_measured_shapefile(path: Path, lines: Sequence[Sequence[np.ndarray]]) -> Path:
    """A shapefile of PolyLineM without a table: each line is a list of parts, corners (k, 3) as x, y, m."""
    records, index, at = b"", b"", 50
    everything = np.concatenate([part for parts in lines for part in parts])
    for number, parts in enumerate(lines, 1):
        corners = np.concatenate(parts)
        starts = np.concatenate([[0], np.cumsum([len(part) for part in parts])[:-1]])
        content = struct.pack("<i4d2i", _SHAPE_POLYLINE_M, *_box(corners), len(parts), len(corners))
        content += starts.astype("<i4").tobytes() + np.ascontiguousarray(corners[:, :2], "<f8").tobytes()
        content += struct.pack("<2d", corners[:, 2].min(), corners[:, 2].max())
        content += np.ascontiguousarray(corners[:, 2], "<f8").tobytes()
        records += struct.pack(">2i", number, len(content) // 2) + content
        index += struct.pack(">2i", at, len(content) // 2)
        at += 4 + len(content) // 2
    measures = (everything[:, 2].min(), everything[:, 2].max())
    for suffix, body in ((".shp", records), (".shx", index)):
        length = (100 + len(body)) // 2
        head = struct.pack(">7i", 9994, 0, 0, 0, 0, 0, length) + struct.pack("<2i", 1000, _SHAPE_POLYLINE_M)
        head += struct.pack("<8d", *_box(everything), 0.0, 0.0, *measures)
        path.with_suffix(suffix).write_bytes(head + body)
    return path.with_suffix(".shp")


def _box(corners: np.ndarray) -> tuple[float, float, float, float]:
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
