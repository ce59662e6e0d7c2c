"""Objects as a table of polygons, and their figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely
from pyproj import CRS

from ..statistics.normal import Z95
from ..vector.cell_polygons import field_kinds, table_column
from .find import Found
from .kinds import DEPOSITS, KINDS, UNKNOWN, VEGETATION, kind_of, standing

FIELDS = field_kinds("""
    text: object_id kind change epoch_from epoch_to
    real: height_m length_m width_m area_m2 volume_m3 volume_low_m3 volume_high_m3
    integer: n_points
    real: confidence
    text: reason
    integer: deposit
    text: zone_id run_id
""")
APPEARED, VANISHED = "appeared", "vanished"
MIN_VEGETATION_AREA_M2 = 1.0
"""Least footprint of vegetation in the table."""


@dataclass(frozen=True)
class Origin:
    """What the table states of the run: the reference system, the days of both surveys, its number."""

    crs: CRS | None
    epochs: tuple[date | None, date | None]
    run_id: str


def objects_frame(found: Sequence[Found], zones: gpd.GeoDataFrame, origin: Origin) -> gpd.GeoDataFrame:
    """One row an object, by kind, then the largest first.

    Ground that rose or sank as a body is left to the ``zones``; an object that overlaps one names it, so that what lies
    in both is counted once.
    """
    kept = [(one, *kind_of(one)) for one in found if standing(one)]
    kept = [row for row in kept if row[1] != VEGETATION or row[0].area.area >= MIN_VEGETATION_AREA_M2]
    kept.sort(key=lambda row: (KINDS.index(row[1]), -row[0].shape.volume))
    count, areas = len(kept), np.array([row[0].area for row in kept], dtype=object)
    shapes, kinds = [row[0].shape for row in kept], [row[1] for row in kept]
    appeared = [row[0].appeared for row in kept]
    days = ["" if day is None else day.isoformat() for day in origin.epochs]
    columns: dict[str, Any] = {
        "object_id": [f"O{number:03d}" for number in range(1, count + 1)],
        "kind": kinds,
        "change": [APPEARED if new else VANISHED for new in appeared],
        "epoch_from": [days[0]] * count,
        "epoch_to": [days[1]] * count,
        "height_m": [shape.height for shape in shapes],
        "length_m": [shape.length for shape in shapes],
        "width_m": [shape.width for shape in shapes],
        "area_m2": [area.area for area in areas],
        "volume_m3": [shape.volume for shape in shapes],
        "volume_low_m3": [max(shape.volume - Z95 * shape.volume_error, 0.0) for shape in shapes],
        "volume_high_m3": [shape.volume + Z95 * shape.volume_error for shape in shapes],
        "n_points": [len(row[0].returns) for row in kept],
        "confidence": [1.0 - row[0].chance for row in kept],
        "reason": [row[2] for row in kept],
        "deposit": [int(new and kind in DEPOSITS) for new, kind in zip(appeared, kinds, strict=True)],
        "zone_id": _zones_of(areas, zones),
        "run_id": [origin.run_id] * count,
    }
    table = {
        name: table_column(np.array(columns[name], dtype=_TYPES[kind]), kind, count) for name, kind in FIELDS.items()
    }
    geometry = [shapely.MultiPolygon([area]) if area.geom_type == "Polygon" else area for area in areas]
    return gpd.GeoDataFrame(pd.DataFrame(table), geometry=gpd.GeoSeries(geometry, crs=origin.crs, dtype="geometry"))


_TYPES = {"text": object, "integer": np.int64, "real": np.float64}


def _zones_of(areas: np.ndarray, zones: gpd.GeoDataFrame) -> list[str]:
    """Of each area the zone that it shares most with; empty if there is none."""
    shapes, names = zones.geometry.to_numpy(), zones["zone_id"].to_numpy() if len(zones) else np.zeros(0, dtype=object)
    found = []
    for area in areas:
        shared = shapely.area(shapely.intersection(shapes, area)) if len(shapes) else np.zeros(1)
        found.append(str(names[int(np.argmax(shared))]) if shared.max() > 0.0 else "")
    return found


def object_figures(frame: gpd.GeoDataFrame) -> dict[str, Any]:
    """Numbers for the run record: objects by kind, and deposits that no zone holds, in m³."""
    new = frame["change"] == APPEARED
    named = ~frame["kind"].isin([VEGETATION, UNKNOWN])
    alone = (frame["deposit"] == 1) & (frame["zone_id"] == "")
    return {
        "objects_appeared": int((named & new).sum()),
        "objects_vanished": int((named & ~new).sum()),
        "objects_unknown": int((frame["kind"] == UNKNOWN).sum()),
        "objects_vegetation": int((frame["kind"] == VEGETATION).sum()),
        "object_deposits": int((frame["deposit"] == 1).sum()),
        "object_deposits_beside_zones_m3": float(frame.loc[alone, "volume_m3"].sum()),
    }
