"""What the report of a series says first, in plain words, and the history of its zones' alert levels."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...interface.alert_states import AlertState, LevelChange, alert_state, level_changes
from ...interface.rates import RateUnit, rate_unit
from ..zones.fields import KINDS, SLIDING
from .figures_in_text import figure, percent, say, significant, value_of, with_error, words_of

_MOST_NAMED = 3
_COLOUR = re.compile(r"#[0-9a-f]{6}")
_DATED = re.compile(r"(\d{4}-\d\d-\d\d): (.*)", re.DOTALL)
_NO_COLOUR = "#9e9e9e"


@dataclass(frozen=True)
class ZoneLevels:
    """Alert of one zone: as it is ``now``, in words and with its ``colour``, and the surveys that changed it."""

    zone_id: str
    now: AlertState
    words: str
    reason: str
    colour: str
    changes: Sequence[LevelChange]
    failure: str = ""


def unit_of_rates(record: Mapping[str, Any]) -> RateUnit:
    """The unit of all rates in the report of a series: by its fastest zone."""
    zones = record.get("zones") or []
    return rate_unit(zone.get(name) for zone in zones for name in ("rate_mm_day", "motion_rate_mm_day"))


def colours(record: Mapping[str, Any]) -> dict[int, str]:
    """Of the alert levels, by the table of the run."""
    found = {}
    for row in record.get("alerts") or []:
        level, colour = value_of(row, "level"), words_of(row, "colour")
        if level is not None and _COLOUR.fullmatch(colour):
            found[int(level)] = colour
    return found


def levels_of(record: Mapping[str, Any], most: int) -> list[ZoneLevels]:
    """The first zones with their alerts; those that never had one are left out."""
    course, shown, found = record.get("course") or {}, colours(record), []
    for zone in (record.get("zones") or [])[:most]:
        now, changes = alert_state(zone), level_changes(course.get(zone["zone_id"]) or [])
        if now is None or not (now.level or now.state or now.reason or changes or words_of(zone, "failure_from")):
            continue
        colour = shown.get(now.level, _NO_COLOUR)
        words = now.words(say), now.reason_words(say)
        found.append(ZoneLevels(str(zone["zone_id"]), now, *words, colour, changes, _failure(zone)))
    return found


def _failure(zone: Mapping[str, Any]) -> str:
    if words_of(zone, "failure_from"):
        ends = words_of(zone, "failure_from"), words_of(zone, "failure_to")
        return say(
            f"Failure by inverse velocity between {ends[0]} and {ends[1]}, if the motion goes on by the same law."
        )
    note = words_of(zone, "failure_note")
    return say(f"Failure time: {note}.") if note and value_of(zone, "alert_level") else ""


def verdict(record: Mapping[str, Any]) -> list[str]:
    """Sentences: what moved, how much and how sure that is; the alerts; what was not seen."""
    zones = record.get("zones") or []
    told = [zone for zone in zones if _is_told(zone)][:_MOST_NAMED]
    found = [_moved(record, zone) for zone in told]
    rest = int(value_of(record["metrics"], "zone_count") or len(zones)) - len(told)
    if not zones:
        found.append(say("No zone changed beyond its level of detection."))
    elif rest > 0:
        found.append(say(f"Further zones in the table: {rest}."))
    if zones and not any(value_of(zone, "alert_level") for zone in zones):
        found.append(say("No zone has an alert level above 0."))
    return [part for part in (*found, _unseen(record)) if part]


def _is_told(zone: Mapping[str, Any]) -> bool:
    """Zones with an alert, or whose alert was withdrawn, and those that two surveys in a row confirm."""
    if value_of(zone, "dz_mean_m") is None:
        return False
    state = alert_state(zone)
    alerted = state is not None and (state.level > 0 or state.state != "")
    return alerted or (value_of(zone, "n_epochs_confirmed") or 0) >= 2


def _moved(record: Mapping[str, Any], zone: Mapping[str, Any]) -> str:
    name, kind, area = zone["zone_id"], words_of(zone, "kind"), significant(zone, "area_m2", "m²")
    course = [row for row in (record.get("course") or {}).get(name) or [] if "dz_mean_m" in row]
    last = course[-1] if course else zone
    sized = {**last, "dz_mean_m": abs(value_of(last, "dz_mean_m") or 0.0)}
    change = with_error(sized, "dz_mean_m", "dz_err_m", "m", 3, sign=False)
    volume = with_error(zone, "vol_net_m3", "vol_err_m3", "m³")
    if kind == SLIDING:
        motion = with_error(zone, "motion_m", "motion_err_m", "m", 3, sign=False)
        words = say(f"{name} slid along the surface by {motion} on {area}.")
    elif kind == KINDS[0]:
        words = say(f"{name} sank by {change} on {area} (net volume {volume}).")
    else:
        words = say(f"{name} rose by {change} on {area} (net volume {volume}).")
    state = alert_state(zone)
    alert = "" if state is None else say(f"Alert level: {state.words(say)}.")
    return " ".join((words, _sureness(int(value_of(zone, "n_epochs_confirmed") or 0)), alert)).strip()


def _sureness(surveys: int) -> str:
    if surveys >= 2:
        return say(f"The last {surveys} surveys in a row confirm it.")
    return say("Only one survey shows it.") if surveys else say("The last survey does not confirm it.")


def _unseen(record: Mapping[str, Any]) -> str:
    metrics, unit = record["metrics"], unit_of_rates(record)
    parts = []
    share = value_of(metrics, "compared_share")
    if share is not None:
        missing = percent({"share": 1.0 - share}, "share")
        parts.append(say(f"The last survey did not compare {missing} of the ground."))
    if value_of(metrics, "detectable_rate_mm_day") is not None:
        slowest = figure(metrics, "detectable_rate_mm_day", unit.name, 0, scale=unit.days)
        parts.append(say(f"Between two surveys, half of the cells do not show movement below {slowest}."))
    return " ".join(parts)


def grouped(warnings: Sequence[str]) -> list[str]:
    """Warnings that several surveys share, once each, after the days of these surveys."""
    days: dict[str, list[str]] = {}
    for warning in warnings:
        dated = _DATED.fullmatch(warning)
        days.setdefault(dated[2] if dated else warning, []).extend([dated[1]] if dated else [])
    return [f"{', '.join(dict.fromkeys(found))}: {words}" if found else words for words, found in days.items()]
