"""Layers of zones with what a run writes of them, made of rectangles."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
from shapely import MultiPolygon, box
from slopewatch.engine.vector.cell_polygons import table_column
from slopewatch.engine.zones.fields import FIELDS

Rectangle = tuple[float, float, float, float]


def zone_layer(
    rectangles: Sequence[Rectangle],
    *,
    ids: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    run: str = "r1",
    fields: dict[str, str] = FIELDS,
    crs: int = 32651,
) -> gpd.GeoDataFrame:
    """Zones of ``rectangles`` (west, south, east, north in metres), unreviewed."""
    count = len(rectangles)
    shapes = [MultiPolygon([box(w, s, e, n)]) for w, s, e, n in rectangles]
    texts: dict[str, Any] = {
        "zone_id": ids or [f"Z{i:03d}" for i in range(1, count + 1)],
        "kind": kinds or ["subsidence"] * count,
        "review_status": ["unreviewed"] * count,
        "run_id": [run] * count,
        "area_m2": [s.area for s in shapes],
    }
    columns = {
        name: table_column(
            None if name not in texts else np.array(texts[name], dtype=np.float64 if kind == "real" else object),
            kind,
            count,
        )
        for name, kind in fields.items()
    }
    return gpd.GeoDataFrame(columns, geometry=np.array(shapes, dtype=object), crs=crs)


def entered(zones: gpd.GeoDataFrame, row: int, **entries: Any) -> gpd.GeoDataFrame:
    """``zones`` with what somebody entered in a row."""
    for name, value in entries.items():
        zones.loc[row, name] = value
    return zones


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """A GeoPackage as a program that knows geometries opens it; what is done is kept."""
    with closing(connected(path)) as database, database:
        yield database


def connected(path: Path) -> sqlite3.Connection:
    """As ``opened``; the caller commits and closes."""
    database = sqlite3.connect(path)
    for name in ("ST_IsEmpty", "ST_MinX", "ST_MaxX", "ST_MinY", "ST_MaxY"):  # GDAL's, for the spatial index
        database.create_function(name, 1, lambda _: 0)
    return database


def enter(path: Path, zone_id: str, **entries: Any) -> None:
    """Enter something in the layer ``zones`` of a file."""
    with opened(path) as database:
        names = ", ".join(f'"{name}" = ?' for name in entries)
        done = database.execute(f"UPDATE zones SET {names} WHERE zone_id = ?", (*entries.values(), zone_id))
        assert done.rowcount == 1
