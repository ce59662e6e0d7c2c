"""The zones of all slopes in one table, each with its slope and its place along the road."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely
from pyproj import CRS

from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.crs.working_frame import horizontal
from ...engine.vector.cell_polygons import field_kinds, table_column
from ...engine.vector.geopackage import read_layer
from ...engine.vector.review_fields import LOCATION, ON_ROAD, REVIEW_FIELDS, UNREVIEWED, in_words, is_entered
from .product_names import SOURCES
from .results import SlopeResult
from .table_columns import column_of

FIELDS = field_kinds("""
    text: zone_id slope source
    integer: attention
    text: kind movement severity
    integer: alert_level
    text: alert alert_state alert_since alert_reason body status
    text: epoch_from epoch_to
    real: confidence dz_mean_m dz_p95_m area_m2 vol_net_m3 vol_err_m3 lod95_m rate_mm_day rate_err motion_m motion_err_m
    text: trend slope_review
    text: slope_id route
    real: chain_from chain_to
    text: side carriageway
    real: offset_m offset_mid_m
    text: location location_note review_status reviewer remarks method run_id
""")
"""Name and kind of each field. ``route`` to ``location_note`` come from the zones of a slope where these were placed on
a road, else people enter them; ``slope_review`` is what people entered there.
"""
_GRADES = {"high": 2, "moderate": 1, "medium": 1}


def corridor_zones(
    results: Sequence[SlopeResult],
    progress: Progress,
) -> gpd.GeoDataFrame:
    """One row a zone of all slopes, in the reference system of the first.

    Raises:
        InputError: the zones of a slope cannot be read.
    """
    tables: list[gpd.GeoDataFrame] = []
    crs: CRS | None = None
    for number, result in enumerate(results):
        progress.update(number / len(results), f"gathering the zones of {result.slope}")
        for key, source in SOURCES:
            path = result.outputs.get(key)
            if path is None:
                continue
            frame = read_layer(path, "zones")
            crs = crs or _crs(frame)
            own = _crs(frame)
            if own is not None and crs is not None and own != crs:
                frame = frame.to_crs(crs)
            tables.append(_table(frame, result.slope, source))
    if not tables:
        return gpd.GeoDataFrame(
            {name: table_column(None, kind, 0) for name, kind in FIELDS.items()}, geometry=[], crs=crs
        )
    rows = {name: [value for t in tables for value in t[name]] for name in FIELDS}
    columns = {name: column_of(rows[name], kind) for name, kind in FIELDS.items()}
    shapes = np.array([shape for t in tables for shape in t.geometry], dtype=object)
    return gpd.GeoDataFrame(columns, geometry=shapes, crs=crs)


def _crs(frame: gpd.GeoDataFrame) -> CRS | None:
    return None if frame.crs is None else horizontal(CRS.from_user_input(frame.crs))


def _table(frame: gpd.GeoDataFrame, slope: str, source: str) -> gpd.GeoDataFrame:
    """The zones of one file with the fields of the corridor."""
    records = frame.drop(columns=frame.geometry.name).to_dict("records")
    rows = []
    for record in records:
        row: dict[str, Any] = {name: record.get(name) for name in FIELDS if name not in REVIEW_FIELDS}
        row |= {"zone_id": f"{slope}/{source}/{record.get('zone_id')}", "slope": slope, "source": source}
        if source == "screening":
            row |= {"severity": record.get("confidence"), "confidence": record.get("probability")}
            row |= {"dz_mean_m": record.get("height_med_m"), "dz_p95_m": record.get("height_p95_m")}
            row["status"] = record.get("confirmed") or ""
        row["body"] = f"{slope}/{source}/{record['body']}" if record.get("body") else ""
        row["attention"] = attention_of(source, row)
        placed = ON_ROAD if is_entered(LOCATION, record.get(LOCATION)) else ()
        row |= {name: record.get(name) for name in placed}
        entered = [n for n in REVIEW_FIELDS if n not in placed and is_entered(n, record.get(n))]
        row["slope_review"] = in_words({n: record[n] for n in entered})
        row["review_status"] = UNREVIEWED
        rows.append(row)
    columns = {name: [row.get(name) for row in rows] for name in FIELDS}
    return gpd.GeoDataFrame(
        pd.DataFrame(columns, dtype=object), geometry=[_multi(s) for s in frame.geometry], crs=frame.crs
    )


def attention_of(source: str, zone: Mapping[str, Any]) -> int:
    """How much a zone asks for: the alert level of a series; 2 for high and 1 for moderate severity of a change.

    A screened zone of high confidence counts 1, because its shape may be old, and 0 where there is a change to go by.
    """
    if source == "series":
        level = zone.get("alert_level")
        return 0 if level is None or pd.isna(level) else int(level)
    grade = _GRADES.get(str(zone.get("severity")), 0)
    if source == "screening":
        return 1 if grade == _GRADES["high"] and not zone.get("status") else 0
    return grade


def _multi(shape: Any) -> Any:
    return shapely.MultiPolygon([shape]) if isinstance(shape, shapely.Polygon) else shape


def last_days(results: Sequence[SlopeResult]) -> dict[str, str]:
    """Day of the last survey by slope.

    Raises:
        InputError: a record names no survey.
    """
    days = {}
    for result in results:
        if not result.days:
            raise InputError(f"{result.folder / 'run.json'} names no survey; remove the folder and run again.")
        days[result.slope] = result.days[-1]
    return days
