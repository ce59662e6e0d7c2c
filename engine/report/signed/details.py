"""Slope, people and flights as a report to sign states them, from the settings in a run record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import geopandas as gpd
import pandas as pd

from ....interface.parameters import DetailParameters
from ...core.errors import InputError
from ..figures_in_text import say

LABELS = {s.name: s.label for s in DetailParameters.specifications()}
FLIGHT = ("flight_dates", "uav", "sensor", "flying_height", "weather")
"""Details of which each survey may have its own."""
_ASKED = ("slope_name", "report_route", "chainage_range", "client", "author", "checker", *FLIGHT[1:])
"""Those that are named where they are missing; the days of the flights are known from the surveys."""
_MAX_CHARACTERS, _MAX_LONG_CHARACTERS = 160, 1500  # of an entry, and of remarks and actions, which share the last page
_LONG = ("report_remarks", "actions", *FLIGHT)
_FIRST_WIDE = 0x2E80  # of the letters that are as wide as two
_KILOMETRE = 1000.0


@dataclass(frozen=True)
class Details:
    """The settings ``given`` by name, empty where nothing was given, and the ``surveys`` by their names."""

    given: Mapping[str, str]
    surveys: tuple[str, ...]

    def __getitem__(self, name: str) -> str:
        return self.given.get(name, "")

    def of_flight(self, name: str, number: int) -> str:
        """A detail of one survey's flight; the survey's own name for the day where none was given."""
        parts = _parts(self[name])
        value = parts[number] if len(parts) > 1 else parts[0]
        return value or (self.surveys[number] if name == "flight_dates" else "")

    @property
    def missing(self) -> list[str]:
        """Labels of what is left to fill in by hand, in the order of the report."""
        return [LABELS[name] for name in _ASKED if not self[name]]


def details_of(record: Mapping[str, Any], surveys: Sequence[str], zones: Sequence[gpd.GeoDataFrame] = ()) -> Details:
    """The details in a run record; route and chainage from the zones' tables where they were not given.

    Raises:
        InputError: a detail has several parts, but not one for each survey, or is longer than a form's entry.
    """
    found = (record.get("parameters") or {}).get("details") or {}
    given = {name: " ".join(str(found.get(name) or "").split()) for name in LABELS if name != "pdf"}
    for name, text in given.items():
        most = _MAX_LONG_CHARACTERS if name in _LONG else _MAX_CHARACTERS
        if text_width(text) > most:
            raise InputError(f"{name} is {text_width(text)} letters wide; give {most} at most, Chinese ones as two.")
    for name in FLIGHT:
        count = len(_parts(given[name]))
        if count > 1 and count != len(surveys):
            raise InputError(
                f"{name} has {count} parts, and there are {len(surveys)} surveys; give one for all, or one for each."
            )
    given["report_route"] = given["report_route"] or _route(zones)
    given["chainage_range"] = given["chainage_range"] or _chainage(zones)
    return Details(given, tuple(surveys))


def text_width(text: str) -> int:
    """Letters that a text is wide; Chinese ones count as two."""
    return sum(2 if ord(letter) >= _FIRST_WIDE else 1 for letter in text)


def chainage_text(metres: float) -> str:
    """A chainage as it stands on a kilometre post: 12+340."""
    kilometres, rest = divmod(round(abs(metres)), round(_KILOMETRE))
    return f"{'−' if metres < 0 else ''}{kilometres}+{rest:03d}"


def place_text(zone: Mapping[str, Any]) -> str:
    """Where a zone lies on its road, by the fields of its table: S320 12+340 to 12+352, left, 4.5 m; empty without."""
    parts = []
    route = _text(zone.get("route"))
    begin, end = (_number(zone.get(name)) for name in ("chain_from", "chain_to"))
    if begin is not None and end is not None and round(begin) != round(end):
        parts.append(f"{route} {chainage_text(begin)}–{chainage_text(end)}".strip())
    elif begin is not None or end is not None:
        parts.append(f"{route} {chainage_text(begin if begin is not None else end or 0.0)}".strip())
    elif route:
        parts.append(route)
    if _text(zone.get("side")):
        parts.append(say(_text(zone.get("side"))))
    offset = _number(zone.get("offset_m"))
    if offset is not None:
        parts.append(f"{offset:.1f} m")
    return ", ".join(parts)


def _parts(text: str) -> list[str]:
    return [part.strip() for part in text.replace("；", ";").split(";")]


def _route(zones: Sequence[gpd.GeoDataFrame]) -> str:
    names = {_text(value) for frame in zones if "route" in frame for value in frame["route"]} - {""}
    return ", ".join(sorted(names))


def _chainage(zones: Sequence[gpd.GeoDataFrame]) -> str:
    values = [
        number
        for frame in zones
        for name in ("chain_from", "chain_to")
        if name in frame
        for value in frame[name]
        if (number := _number(value)) is not None
    ]
    if not values:
        return ""
    low, high = chainage_text(min(values)), chainage_text(max(values))
    return low if low == high else f"{low}–{high}"


def _text(value: Any) -> str:
    return value.strip() if isinstance(value, str) else ""


def _number(value: Any) -> float | None:
    return None if value is None or isinstance(value, str) or pd.isna(value) else float(value)
