"""Zones and events of a finished run as rows for a database, with ids that stay."""

from __future__ import annotations

import hashlib
import json
import math
import uuid
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import date, datetime, timezone
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ..engine.core.errors import InputError
from ..engine.crs.working_frame import horizontal
from ..engine.handover.held import Held, HeldLayer
from ..engine.handover.postgis.schema import EVENTS, ZONES
from ..engine.handover.postgis.writing import Rows
from ..engine.vector.review_fields import STATES
from ..interface.reviews import STATUS
from .batch.alert_events import ACKNOWLEDGED, CLOSED, RAISED
from .batch.corridor_zones import attention_of

_STATE_OF = dict(zip(STATES, (RAISED, ACKNOWLEDGED, CLOSED), strict=True))
MOTION = "motion"
"""Source of a zone of coherent motion; it asks to be observed, as a zone of a series does that moved."""
_CALM = "The zone does not ask for attention any more at the survey of {day}."
_NUMBERS, _DAYS = ("double precision", "integer"), ("date",)
_MADE = {"id", "run_id", "started", "layer", "zone_id", "slope", "source", "attention", "fields", "shape", "road_point"}
"""Columns that are not read from a field of the same name."""


def rows_of(held: Held, road_points: Mapping[str, Sequence[BaseGeometry | None]]) -> Rows:
    """What a database takes of a run.

    Args:
        road_points: for each layer of zones by name, the point on the road of each row; none without a centreline.

    Raises:
        InputError: the run holds no zones, or these have no reference system.
    """
    layers = [layer for layer in held.zones if "zone_id" in layer.frame and _is_of_zones(layer, held)]
    crs = next((p.crs for layer in layers if (p := layer.places) is not None and p.crs is not None), None)
    if not layers:
        raise InputError("The run holds no layer of zones, so there is nothing for a database; leave --to out.")
    if crs is None:
        raise InputError(
            "The zones of the run have no reference system, which a database needs; give --crs in its run."
        )
    run = _run(held)
    zones = [row for layer in layers for row in _zones(layer, run, held, road_points.get(layer.name, ()))]
    events, calm = _events(held, run, zones)
    why = _CALM.format(day=run["days"][-1]) if run["days"] else ""
    flat = CRS.from_user_input(crs)
    return Rows(run, zones, events, horizontal(flat) or flat, calm, why)


def _is_of_zones(layer: HeldLayer, held: Held) -> bool:
    """A series' zones of motion hold a row for each survey, and are zones of the series already."""
    return held.record["command"] != "series" or "alert_level" in layer.frame


def _run(held: Held) -> dict[str, Any]:
    record = held.record
    made_of = {name: record.get(name) for name in ("command", "inputs", "parameters")}
    digest = hashlib.sha256(json.dumps(made_of, sort_keys=True, default=str).encode()).hexdigest()
    run_id = record.get("run_id") or str(record.get("made_of") or digest)[:12]
    details = record.get("parameters", {}).get("details") or {}
    return {
        "run_id": _plain(run_id), "command": record["command"],
        "slope": _plain(details.get("slope_name") or held.folder.name), "days": list(held.days),
        "software": _plain(record.get("software", "")), "started": _moment(record.get("started")),
        "record": _plain(dict(record)),
    }  # fmt: skip


def _moment(text: Any) -> datetime:
    try:
        moment = datetime.fromisoformat(str(text))
    except ValueError:
        return datetime(1970, 1, 1, tzinfo=timezone.utc)
    return moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)


def _id(*parts: Any) -> uuid.UUID:
    return uuid.uuid5(uuid.NAMESPACE_OID, repr(("slopewatch", *(str(part) for part in parts))))


def _scope(source: str, zone: Mapping[str, Any], run: Mapping[str, Any], held: Held) -> tuple[str, ...]:
    """What makes the id of a zone one that no other has: ids of a series stay, those of two surveys are the run's."""
    if run["command"] == "batch":
        return ("corridor",) if source == "series" else ("corridor", str(zone.get("run_id") or ""))
    if source == "series":
        first = next((i["sha256"] for i in held.record.get("inputs", ()) if str(i["role"]).startswith("epoch ")), "")
        return ("series", str(first) or str(run["slope"]))
    return "run", str(run["run_id"])


def _source(zone: Mapping[str, Any], run: Mapping[str, Any]) -> str:
    if run["command"] == "batch":
        return str(zone.get("source") or "")
    if run["command"] == "series" and "alert_level" in zone:
        return "series"
    if "along_m" in zone:
        return MOTION
    return "screening" if "probability" in zone else "change"


def _zones(
    layer: HeldLayer, run: Mapping[str, Any], held: Held, points: Sequence[BaseGeometry | None]
) -> list[dict[str, Any]]:
    found = []
    seen: Counter[str] = Counter()
    for number, (zone, shape) in enumerate(_records(layer.frame)):
        source = _source(zone, run)
        name = "series" if source == "series" else layer.name
        row = {column: _value(zone.get(column), kind) for column, kind in ZONES.items() if column not in _MADE}
        graded = {"severity": zone.get("confidence"), "status": zone.get("confirmed") or ""}
        if source == "screening" and run["command"] != "batch":
            row |= {column: _value(value, "text") for column, value in graded.items()}
        if source == MOTION:
            row |= {"motion_m": _number(zone["along_m"]), "motion_err_m": _number(zone.get("along_err_m"))}
        seen[str(zone["zone_id"])] += 1  # people may have cut a zone in two
        part = seen[str(zone["zone_id"])]
        own = (zone["zone_id"],) if part == 1 else (zone["zone_id"], part)
        row |= {
            "id": _id("zone", *_scope(source, zone, run, held), name, *own), "run_id": run["run_id"],
            "started": run["started"], "layer": layer.name, "zone_id": _plain(str(zone["zone_id"])), "source": source,
            "slope": _plain(str(zone.get("slope") or zone.get("slope_id") or run["slope"])),
            "made_by": _value(zone.get("run_id"), "text"), "attention": _attention(source, zone, row),
            "fields": _plain({n: v for n, v in zone.items() if n not in ZONES}), "shape": _multi(shape),
            "road_point": points[number] if number < len(points) else None,
        }  # fmt: skip
        found.append(row)
    return found


def _attention(source: str, zone: Mapping[str, Any], row: Mapping[str, Any]) -> int:
    given = zone.get("attention")
    if given is not None and not pd.isna(given):
        return int(given)
    if source == MOTION:
        return 1
    return attention_of(source, {**zone, "severity": row["severity"], "status": row["status"]})


def _events(
    held: Held, run: Mapping[str, Any], zones: Sequence[Mapping[str, Any]]
) -> tuple[list[dict[str, Any]], list[Any]]:
    """The events, and the zones of a series that ask for nothing."""
    if run["command"] == "batch":
        alerts = next((layer for layer in held.layers if layer.name == "alerts"), None)
        return [] if alerts is None else _of_alerts(alerts, run, zones), []
    asking = [z for z in zones if z["source"] != "series" or (z["attention"] > 0 and _leads(z))]
    calm = [z["id"] for z in zones if z["source"] == "series" and z["attention"] == 0]
    return [_of_zone(zone, run) for zone in asking], calm


def _leads(zone: Mapping[str, Any]) -> bool:
    """Whether a zone speaks for its body, which has one event."""
    return zone["fields"].get("body") in (None, "", zone["zone_id"])


def _of_zone(zone: Mapping[str, Any], run: Mapping[str, Any]) -> dict[str, Any]:
    """The event of a zone: its review says in which state it is."""
    more = zone["fields"]
    days = run["days"]
    alert = [str(more[n]) for n in ("alert", "alert_reason") if more.get(n)]
    return {
        **{column: zone[column] for column in EVENTS if column in zone},
        "id": _id("event", zone["id"]), "zone": zone["id"],
        "reason": ": ".join(alert) or " ".join(p for p in (zone["severity"], zone["status"]) if p),
        "raised_on": _value(more.get("first_seen"), "date") or zone["epoch_to"] or (days[-1] if days else None),
        "last_on": _value(more.get("last_seen"), "date") or zone["epoch_to"] or (days[-1] if days else None),
        "ended_on": None, "state": _STATE_OF.get(str(zone[STATUS]), RAISED), "state_reason": "",
    }  # fmt: skip


def _of_alerts(layer: HeldLayer, run: Mapping[str, Any], zones: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    by_name = {zone["zone_id"]: zone for zone in zones}
    found = []
    for alert, shape in _records(layer.frame):
        zone = by_name.get(str(alert["zone_id"]), {})
        row = {c: _value(alert.get(c), kind) for c, kind in EVENTS.items() if c not in _MADE}
        placed = {c: zone.get(c) for c in ("route", "carriageway", "side", "offset_m")}
        state = str(alert.get("state") or "").strip().lower()
        row |= {
            **placed, "id": _id("event", "corridor", alert["slope"], alert["alert_id"]), "zone": zone.get("id"),
            "run_id": run["run_id"], "started": run["started"], "zone_id": _plain(str(alert["zone_id"])),
            "slope": _plain(str(alert["slope"])), "source": _plain(str(alert.get("source") or "")),
            "attention": int(_value(alert.get("attention"), "integer") or 0), "shape": _multi(shape),
            "road_point": zone.get("road_point"), "state": _plain(state) or RAISED,
        }  # fmt: skip
        found.append(row)
    return found


def _records(frame: Any) -> list[tuple[dict[str, Any], Any]]:
    table = gpd.GeoDataFrame(frame)
    plain = table.drop(columns=table.geometry.name).to_dict("records")
    return list(zip(({str(k): v for k, v in row.items()} for row in plain), table.geometry, strict=True))


def _multi(shape: Any) -> Any:
    if shape is None or shape.is_empty:
        return None
    flat = shapely.force_2d(shape)
    return flat if flat.geom_type == "MultiPolygon" else shapely.MultiPolygon([flat])


def _value(value: Any, kind: str) -> Any:
    """A cell as a column of this kind takes it; None for a gap or what is none of that kind."""
    if value is None or (not isinstance(value, str) and pd.isna(value)):
        return "" if kind == "text" else None
    if kind == "integer":
        return int(value)
    if kind in _NUMBERS:
        return _number(value)
    if kind in _DAYS:
        return _day(value)
    return _plain(str(value))


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _day(value: Any) -> date | None:
    try:
        return date.fromisoformat(str(value)[:10])
    except ValueError:
        return None


def _plain(value: Any) -> Any:
    """``value`` as JSON and PostgreSQL take it: without gaps of numpy and without NUL in texts."""
    if isinstance(value, Mapping):
        return {_plain(str(name)): _plain(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, str):
        return value.replace("\0", "").encode("utf-8", "replace").decode()
    if isinstance(value, np.generic):
        return _plain(value.item())
    if value is None or isinstance(value, (bool, int)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return None if pd.isna(value) else str(value)
