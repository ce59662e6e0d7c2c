"""The alert levels of the zones of a corridor, in the words of the slopes' own reports."""

from __future__ import annotations

from typing import Any

import geopandas as gpd

from ...interface.alert_states import alert_state
from .figures_in_text import say


def levels_of_zones(zones: gpd.GeoDataFrame) -> dict[str, str]:
    """By the id of each zone of a series its alert level and state in words, as its own report has them."""
    states = ((str(row["zone_id"]), alert_state(row)) for row in _records(zones))
    return {zone: state.words(say) for zone, state in states if state is not None}


def withdrawn_of(zones: gpd.GeoDataFrame) -> list[dict[str, str]]:
    """Zones of a series whose alert is withdrawn: slope, zone, level and reason. A body of several has one row."""
    found = []
    for row in _records(zones):
        state, names = alert_state(row), {"slope": str(row["slope"]), "zone_id": str(row["zone_id"])}
        if state is not None and state.state == "withdrawn" and row.get("body") in (None, "", row["zone_id"]):
            found.append({**names, "level": state.words(say), "reason": state.reason_words(say)})
    return found


def _records(zones: gpd.GeoDataFrame) -> list[dict[str, Any]]:
    return [] if "alert_level" not in zones else zones.drop(columns=zones.geometry.name).to_dict("records")
