"""What people enter in the tables of zones: the fields for it, and the states of a review."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import geopandas as gpd
import pandas as pd

from ...interface.reviews import REMARKS, REVIEWED, REVIEWER, STATES, STATUS, UNREVIEWED

__all__ = [
    "LOCATION",
    "LOCATION_FIELDS",
    "ON_ROAD",
    "PLACE_FIELDS",
    "REVIEW_FIELDS",
    "STATES",
    "UNREVIEWED",
    "in_words",
    "is_entered",
    "is_located",
    "own_columns",
]

PLACE_FIELDS: dict[str, str] = {
    "slope_id": "text",
    "route": "text",
    "chain_from": "real",
    "chain_to": "real",
    "side": "text",
}
"""Where a zone lies by the register of slopes, or along a centreline, where one was given."""
LOCATION = "location"
"""Route and chainages as text; filled only where the place of a zone was computed, and then nobody edits it."""
LOCATION_FIELDS: dict[str, str] = {
    "carriageway": "text",
    "offset_m": "real",
    "offset_mid_m": "real",
    LOCATION: "text",
    "location_note": "text",
}
"""What a centreline says of a zone in addition; empty without one."""
ON_ROAD: tuple[str, ...] = ("route", "chain_from", "chain_to", "side")
"""Those of ``PLACE_FIELDS`` that a centreline fills in."""
REVIEW_FIELDS: dict[str, str] = {**PLACE_FIELDS, STATUS: "text", REVIEWER: "text", REMARKS: "text"}
"""Name and kind of every field that people fill in; all others are measured."""


def own_columns(frame: pd.DataFrame, known: Iterable[str]) -> tuple[str, ...]:
    """Columns that people added to a table whose fields are ``known``."""
    geometry = frame.geometry.name if isinstance(frame, gpd.GeoDataFrame) else None
    fields = {name.lower() for name in (*known, *REVIEW_FIELDS)}
    return tuple(name for name in frame.columns if name != geometry and name.lower() not in fields)


def is_entered(field: str, value: object) -> bool:
    """Whether a person must have entered ``value``: it is no gap, and not the state that every zone begins with."""
    if value is None or (not isinstance(value, str) and bool(pd.isna(value))):
        return False
    text = str(value).strip()
    return bool(text) and not (field == STATUS and text == UNREVIEWED)


def is_located(frame: pd.DataFrame) -> bool:
    """Whether the place of a zone was computed from a centreline, or it says why it has none."""
    names = (LOCATION, "location_note")
    return any(is_entered(name, value) for name in names if name in frame for value in frame[name])


def in_words(entries: Mapping[str, object]) -> str:
    """A review as text, such as ``confirmed by A. Sato on 2025-05-02; route: S1; remarks: crack``."""
    rest = dict(entries)
    status, reviewer, day = rest.pop(STATUS, ""), rest.pop(REVIEWER, ""), rest.pop(REVIEWED, "")
    head = f"{status or 'entries'} by {reviewer}" if reviewer else f"{status}"
    head += f" on {day}" if day else ""
    parts = [f"{name}: {value:g}" if isinstance(value, float) else f"{name}: {value}" for name, value in rest.items()]
    return "; ".join(part for part in (head, *parts) if part)
