"""Alerts as events: raised by a zone, acknowledged and closed by people, closed or withdrawn by a later survey."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd

from ...engine.vector.cell_polygons import field_kinds, table_column
from ...engine.zones.fields import SLIDING
from ...engine.zones.matching import match_zones
from ...interface.alert_states import alert_state
from .table_columns import column_of

RAISED, ACKNOWLEDGED, CLOSED, WITHDRAWN = STATES = ("raised", "acknowledged", "closed", "withdrawn")
FIELDS = field_kinds("""
    text: alert_id slope zone_id kind source
    integer: attention
    text: reason raised_on last_on ended_on
    text: location
    real: chain_from chain_to
    text: state state_reason reviewer remarks
""")
FORMER = {"chainage_from": "chain_from", "chainage_to": "chain_to"}
"""Fields of earlier releases, by their names now."""
OWN = ("state", "state_reason")
ENTERED = (*OWN, "reviewer", "remarks")
"""Fields that people fill in; ``OWN`` are those that other tables do not have."""


def follow_alerts(
    earlier: gpd.GeoDataFrame | None, zones: gpd.GeoDataFrame, last_days: Mapping[str, str]
) -> gpd.GeoDataFrame:
    """The events of an earlier run carried on, and one for each zone that asks for attention anew.

    An event stays while its zone asks for as much; what people entered stays with it, whatever happens. Where the
    zone asks for more or less, or for nothing, the event is closed with the reason, and in the first two cases a new
    one is raised; where the series withdrew the level, the event is withdrawn with the reason of that. An event that
    people closed is not raised again while its zone asks for as much as it did. Zones that are one body have one event.

    Args:
        earlier: the events of an earlier run, with ``FIELDS``; None where there was none.
        zones: of all slopes, see ``corridor_zones``.
        last_days: day of the last survey by slope; events of other slopes are not touched.
    """
    asks = ((zones["attention"].fillna(0) > 0) & _leads(zones)).to_numpy()
    rows: list[dict[str, Any]] = []
    answered: set[int] = set()
    if earlier is not None and len(earlier):
        if earlier.crs is not None and zones.crs is not None and earlier.crs != zones.crs:
            earlier = earlier.to_crs(zones.crs)
        heirs = _heirs(earlier, zones)
        latest = _latest(earlier, heirs)
        for number, record in enumerate(earlier.to_dict("records")):
            row = {name: record.get(name) for name in FIELDS} | {"geometry": record["geometry"]}
            slope = str(record["slope"])
            if slope in last_days:
                heir = heirs[number]
                zone = None if heir is None else zones.iloc[heir]
                if _carry_on(row, zone, last_days[slope]) and heir is not None and latest[number]:
                    answered.add(heir)
            rows.append(row)
    taken = {str(row["alert_id"]) for row in rows}
    for position, zone in zip(np.flatnonzero(asks), zones[asks].to_dict("records"), strict=True):
        if int(position) not in answered:
            rows.append(_raised(zone, last_days[str(zone["slope"])], taken))
    return _frame(rows, zones)


def open_of(alerts: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """The events that neither people nor a later survey have closed."""
    return alerts[~alerts["state"].map(_is_closed).astype(bool)]


def _leads(zones: gpd.GeoDataFrame) -> pd.Series:
    """Whether a zone speaks for its body, as most do that are one of their own."""
    body = zones["body"].fillna("")
    return (body == "") | (body == zones["zone_id"])


def _heirs(earlier: gpd.GeoDataFrame, zones: gpd.GeoDataFrame) -> list[int | None]:
    """The zone (row number) that continues each event's, of the same slope."""
    found: list[int | None] = [None] * len(earlier)
    before, now = (frame.groupby("slope", sort=True).indices for frame in (earlier, zones))
    for slope, old in before.items():
        new = now.get(slope)
        if new is None:
            continue
        matches = match_zones(earlier.iloc[old], zones.iloc[new], persistent_ids=True)
        for place, heirs in zip(old, matches.heirs, strict=True):
            found[int(place)] = int(new[heirs[0]]) if heirs else None
    return found


def _latest(earlier: gpd.GeoDataFrame, heirs: list[int | None]) -> list[bool]:
    """Whether an event is the last one of its zone: only that speaks for it."""
    newest: dict[int, tuple[tuple[str, bool], int]] = {}
    for number, (day, state, heir) in enumerate(zip(earlier["raised_on"], earlier["state"], heirs, strict=True)):
        if heir is not None:
            age = str(day), not _is_closed(state)
            newest[heir] = max(newest.get(heir, (age, number)), (age, number))
    return [heir is not None and newest[heir][1] == number for number, heir in enumerate(heirs)]


def _is_closed(state: Any) -> bool:
    return str(state or "").strip().lower() in (CLOSED, WITHDRAWN)


def _carry_on(row: dict[str, Any], zone: pd.Series | None, day: str) -> bool:
    """Bring an event up to date with its zone; whether it answers for what the zone asks now."""
    closed = _is_closed(row.get("state"))
    part = zone is not None and bool(zone["body"]) and zone["body"] != zone["zone_id"]
    before, now = int(row["attention"]), 0 if zone is None or part else int(zone["attention"])
    if now == before:
        if not closed:
            row |= {"last_on": day, "reason": _reason(zone), "zone_id": zone["zone_id"]} if zone is not None else {}
        # closed by a survey that found less: what asks again is raised again
        return not closed or not row.get("ended_on")
    if not closed:
        state = CLOSED
        if zone is None:
            why = f"No zone of the survey of {day} continues it."
        elif part:
            why = f"It is one body with {zone['body']} at the survey of {day}."
        elif now < before and (level := alert_state(zone)) is not None and level.state == WITHDRAWN:
            state, why = WITHDRAWN, f"Survey of {day}: {level.reason}."
        elif now == 0:
            why = f"The zone does not ask for attention any more at the survey of {day}."
        else:
            why = f"Its attention is {now} instead of {before} at the survey of {day}."
        row |= {"state": state, "ended_on": day, "state_reason": _joined(row.get("state_reason"), why)}
        return False
    if now == 0 and not row.get("ended_on"):
        row["ended_on"] = day
    return not row.get("ended_on") and now < before


def _joined(before: Any, sentence: str) -> str:
    text = "" if before is None or (not isinstance(before, str) and pd.isna(before)) else str(before).strip()
    return f"{text} {sentence}".strip()


def _reason(zone: Mapping[str, Any] | pd.Series) -> str:
    level = alert_state(zone) if zone["source"] == "series" else None
    if level is not None:
        return f"{level.name}: {level.reason}"
    words = f"{zone['severity']} severity" if zone["source"] == "change" else "high confidence of the screening"
    moved = zone.get("motion_m")
    if zone["kind"] == SLIDING and moved is not None and not pd.isna(moved):
        return f"{words}, {SLIDING} by {float(moved):.2f} m"
    height = zone["dz_p95_m"]
    return words if pd.isna(height) else f"{words}, {zone['kind']} of up to {abs(float(height)):.2f} m"


def _raised(zone: Mapping[str, Any], day: str, taken: set[str]) -> dict[str, Any]:
    for number in range(len(taken) + 1):
        text = f"{zone['zone_id']} {zone['attention']} {day} {number}"
        alert_id = hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()[:10]
        if alert_id not in taken:
            break
    taken.add(alert_id)
    names = ("slope", "zone_id", "kind", "source", "attention", "location", "chain_from", "chain_to", "geometry")
    row = {name: zone[name] for name in names}
    return row | {
        "alert_id": alert_id, "reason": _reason(zone), "raised_on": day, "last_on": day, "state": RAISED,
    }  # fmt: skip


def _frame(rows: list[dict[str, Any]], zones: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    rows = sorted(rows, key=lambda row: (_is_closed(row["state"]), -int(row["attention"])))
    columns = {name: column_of([row.get(name) for row in rows], kind) for name, kind in FIELDS.items()}
    if not rows:
        columns = {name: table_column(None, kind, 0) for name, kind in FIELDS.items()}
    shapes = np.array([row["geometry"] for row in rows], dtype=object)
    return gpd.GeoDataFrame(columns, geometry=shapes if rows else [], crs=zones.crs)
