"""What the thresholds mean: from which change on something is reported, and how it is graded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ....interface.rates import RateUnit, rate_unit
from ....interface.rounding import significant_decimals
from ...zones.confirmation import VERDICTS
from ..compose import MEANINGS
from ..figures_in_text import NOT_KNOWN, figure, percent, say, value_of
from . import blocks
from .blocks import Block, Cell, Column

_CRITERIA = (
    ("epochs_confirmed", "Surveys in a row"),
    ("rate_mm_day", "Velocity"),
    ("tangent_angle_deg", "Tangent angle (°)"),
    ("failure_within_days", "Failure within (days)"),
    ("single_volume_m3", "Volume of an event (m³)"),
    ("chance_percent", "Chance of error (%)"),
    ("quiet_surveys", "Quiet surveys"),
)


def explained(record: Mapping[str, Any], *, has_screened: bool) -> list[Block]:
    """Terms with the figures of this run, and of a series the table of alerts."""
    face = record["command"] == "m3c2"
    compared = bool(record.get("epochs")) or face or record["command"] == "series"
    zones = (record.get("parameters", {}).get("zones") or {}) if compared else {}
    rows = [*_level(record), *_zones(zones, series=bool(record.get("alerts")), face=face)]
    if has_screened:
        rows += _screened(record, compared=compared)
    made: list[Block] = []
    if rows:
        made += [blocks.heading(say("Thresholds explained")), blocks.terms(rows)]
    if record.get("alerts"):
        made += [blocks.heading(say("Alert levels"), 2), *_alerts(record["alerts"])]
    if has_screened and record.get("epochs"):
        words = [(_begun(say(word)), say(MEANINGS[word])) for word in VERDICTS]
        made += [blocks.heading(say("What the change says of screened zones"), 2), blocks.terms(words)]
    return made


def _begun(words: str) -> str:
    """With a capital where the letters have them."""
    return words[:1].upper() + words[1:]


def _level(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    metrics = record["metrics"]
    if value_of(metrics, "lod_median_m") is None:
        return []
    sure = percent(metrics, "confidence") if value_of(metrics, "confidence") is not None else "95\u00a0%"
    if record["command"] == "m3c2":
        words = say(
            f"The distance that the points of both cylinders, their scatter, plants and the registration could make "
            f"alone, at {sure} confidence; its median here is {figure(metrics, 'lod_median_m', 'm')}."
        )
        return [(say("Level of detection"), words)]
    words = say(
        f"The change that the points of a cell, their scatter, plants and the registration could make alone, at {sure} "
        f"confidence; its median here is {figure(metrics, 'lod_median_m', 'm')}. Each cell has its own level."
    )
    return [(say("Level of detection"), words)]


def _zones(parameters: Mapping[str, Any], *, series: bool, face: bool) -> list[tuple[str, str]]:
    if not parameters:
        return []
    area, cells = figure(parameters, "minimum_area", "m²", 2), figure(parameters, "minimum_cells", digits=0)
    zone = say(f"Adjoining cells beyond their level of detection, together at least {area} and {cells} cells.")
    if face:
        zone = say(
            f"Adjoining cells of the face, of which one in twenty is unchanged at most, together at least {area} and "
            f"{cells} cells."
        )
    rows = [
        (say("Zone"), zone),
        (
            say("Net volume"),
            say(
                "The change summed over the footprint of the zone, small gaps included; ± is one standard error, with "
                "the registration’s part in full."
            ),
        ),
    ]
    if series:
        return rows
    moderate, high = figure(parameters, "severity_moderate", "m", 2), figure(parameters, "severity_high", "m", 2)
    sure = percent(parameters, "minimum_confidence")
    return [
        *rows,
        (
            say("Severity"),
            say(
                f"By the 95th percentile of the zone’s change: low below {moderate}, moderate from there, high from "
                f"{high} on. It grades the size of the change, not the danger."
            ),
        ),
        (
            say("Confidence"),
            say(
                "The probability that the mean change of a zone is not zero even if the errors of all its cells were "
                f"alike; groups below {sure} are no zones."
            ),
        ),
    ]


def _screened(record: Mapping[str, Any], *, compared: bool) -> list[tuple[str, str]]:
    parameters = record.get("parameters", {})
    group: Mapping[str, Any] = next((g for g in parameters.values() if "minimum_hazard_area" in g), {})
    rows = []
    area = figure(group, "minimum_hazard_area", "m²", 2)
    if area != NOT_KNOWN:
        rows.append(
            (
                say("Screened zone"),
                say(
                    f"Adjoining cells whose ground points are labelled raised or lowered by their shape, {area} at "
                    "least."
                ),
            )
        )
    rows += [
        (
            say("Confidence of a screened zone"),
            say(
                "By the mean probability of its points: high from 0.85, medium from 0.65, else low; one step lower "
                "where it is smaller than 1 m², has fewer than 50 points, or a median height against its kind."
            ),
        ),
        (
            say("Height over the trend"),
            say("Of the zone’s points over the surface of the ground around it; the median, and the 95th percentile."),
        ),
    ]
    if not compared:
        words = say("Whether a zone moves, only a second survey shows; the words for it are these.")
        rows.append((say("One survey"), words))
        rows += [(_begun(say(word)), say(MEANINGS[word])) for word in VERDICTS]
    return rows


def _alerts(table: list[dict[str, Any]]) -> list[Block]:
    columns = [Column(say("Level")), Column(say("Alert"), left=True, width=27.0)]
    unit = rate_unit(row.get("rate_mm_day") for row in table)
    heads = [f"{say(words)} ({say(unit.name)})" if name == "rate_mm_day" else say(words) for name, words in _CRITERIA]
    columns += [Column(head, width=16.0) for head in heads]
    columns.append(Column(say("Action"), left=True, wide=True))
    rows: list[list[Cell]] = [
        [
            figure(row, "level", digits=0),
            say(str(row.get("name", ""))),
            *(_criterion(row, name, unit) for name, _ in _CRITERIA),
            say(str(row.get("action", ""))),
        ]
        for row in table
    ]
    words = say(
        "A zone reaches a level when so many comparisons in a row confirm it and velocity, tangent angle or time to "
        "failure is beyond its limit, or when its volume is beyond that of an event, each with at most this chance of "
        "error. A level is withdrawn after so many quiet surveys in a row."
    )
    return [blocks.paragraph(words, small=True), blocks.table(columns, rows, size=7.0)]


def _criterion(row: Mapping[str, Any], name: str, unit: RateUnit) -> str:
    value = value_of(row, name)
    if name == "rate_mm_day":
        return figure(row, name, digits=significant_decimals(unit.days * (value or 0.0)), scale=unit.days)
    return figure(row, name, digits=0 if value is None or value == round(value) else 1)
