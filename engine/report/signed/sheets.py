"""A sheet for each zone: map, figures, section or course, motion, review and photo, and lines to write on."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import geopandas as gpd
import numpy as np
import shapely
from numpy.typing import NDArray

from ....interface.alert_states import alert_state
from ....interface.rates import RateUnit
from ...zones.fields import SLIDING
from ..embedding import Picture
from ..figures_in_text import figure, interval, percent, say, significant, value_of, with_error, words_of
from ..reviews import Review
from ..series_words import ZoneLevels, levels_of, unit_of_rates
from . import blocks
from .blocks import Block, Cell, Column, Document
from .courses import course_drawing, has_motion
from .details import place_text, text_width
from .maps import MapLayers, zone_map
from .rasters import Surface
from .sections import Section, section_drawing, zone_sections

MOST_SHEETS = 12
_MAP_MM = 90.0, 108.0
_SECTION_MM, _LOW_SECTION_MM, _COURSE_MM = 70.0, 40.0, 52.0
_LAST_SURVEYS = 5
_LAST_CHANGES = 4
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"
_MAX_REMARKS = 700  # letters of a review on a sheet; the HTML report has all of it


@dataclass(frozen=True)
class Zones:
    """What the sheets are made of: the table of ``zones``, and of the same folder ``surface``, ``layers`` of the maps,
    ``reviews`` by id, names of the ``epochs``, the run ``record``, and ``events`` by zone and survey.
    """

    zones: gpd.GeoDataFrame
    surface: Surface | None
    layers: MapLayers
    reviews: Mapping[str, Review]
    epochs: tuple[str, str]
    record: Mapping[str, Any]
    events: Mapping[tuple[str, str], str] = field(default_factory=dict)

    @property
    def shown(self) -> gpd.GeoDataFrame:
        """Those that get a sheet: the first of the table, which is in the order of their severity or alert."""
        return self.zones.iloc[:MOST_SHEETS]


def zone_sheets(document: Document, of: Zones) -> list[Block]:
    """The sheets of the first ``MOST_SHEETS`` zones."""
    shown = of.shown
    sections: Sequence[Section | None] = [None] * len(shown)
    # a section of the map does not show a face, which may be a wall
    if of.surface is not None and len(shown) and of.record["command"] != "m3c2":
        sections = zone_sections(of.surface, shown)
    made = []
    for number, (row, section) in enumerate(zip(shown.to_dict("records"), sections, strict=True)):
        letter = _LETTERS[number % len(_LETTERS)]
        made.append(_sheet(document, of, row, section, letter))
    return made


def sheet_label(zone_id: str) -> str:
    """What links lead to."""
    return f"zone-{zone_id}"


def _sheet(document: Document, of: Zones, row: Mapping[str, Any], section: Section | None, letter: str) -> Block:
    zone_id = words_of(row, "zone_id")
    lines = list(of.layers.lines) + ([(letter, section.line)] if section else [])
    picture = zone_map(of.surface, replace(of.layers, lines=lines), row["geometry"], *_MAP_MM)
    series = "alert_level" in row
    left = [document.picture(picture, say(f"Map of {zone_id} and its surroundings"))]
    right = [blocks.facts(_facts(of, row), 1, gap=1.2 if series else 2.6, size=7.5 if series else 8.2)]
    parts: list[tuple[float, list[Block]]] = [
        (0, [blocks.heading(_title(row), 1, sheet_label(zone_id))]),
        (10.0, [blocks.side_by_side(left, right, 0.52, high=True)]),
    ]
    if section is not None:
        high = _LOW_SECTION_MM if series else _SECTION_MM
        parts.append((4.4 if series else 6.6, [_section(document, of, section, (letter, zone_id), high)]))
    parts += zone_history(document, of.record, zone_id, of.events)
    motion = _motion_of(of.layers.vectors, row["geometry"])
    if motion:
        parts.append((0, [blocks.paragraph(motion)]))
    parts.append((0, review_blocks(document, of.reviews.get(zone_id))))
    if not series:
        parts.append((2.8, [blocks.lines()]))
    return blocks.sheet(parts)


def _title(row: Mapping[str, Any]) -> str:
    kind, grade = words_of(row, "kind"), words_of(row, "severity") or words_of(row, "alert")
    words = ", ".join(say(part) for part in (kind, grade) if part)
    return f"{say('Zone')} {words_of(row, 'zone_id')}: {words}"


def _facts(of: Zones, row: Mapping[str, Any]) -> list[tuple[str, str]]:
    point = row["geometry"].representative_point()
    common = [
        (say("Place (x, y)"), f"{point.x:.1f}, {point.y:.1f}"),
        (say("On the road"), place_text(row)),
    ]
    if "alert_level" in row:
        return _series_facts(row, unit_of_rates(of.record)) + common
    rows = [
        (say("Mean change"), figure(row, "dz_mean_m", "m", sign=True)),
        (say("Change, 95th percentile"), figure(row, "dz_p95_m", "m", sign=True)),
        (say("Lowest and highest change"), interval(row, "dz_min_m", "dz_max_m", "m", 3)),
        (say("Level of detection, median"), figure(row, "lod95_m", "m")),
        (say("Confidence"), percent(row, "confidence")),
        (say("Area of the zone"), figure(row, "area_m2", "m²", 2)),
        (say("Net volume within the zone"), with_error(row, "zone_net_m3", "zone_err_m3", "m³")),
        (say("Area of the footprint"), figure(row, "vol_area_m2", "m²", 2)),
        (say("Net volume over the footprint"), with_error(row, "vol_net_m3", "vol_err_m3", "m³")),
        (say("95 % interval of the volume"), interval(row, "vol_low_m3", "vol_high_m3", "m³")),
        (say("Measured part of the footprint"), percent(row, "vol_measured")),
    ]
    if value_of(row, "rate_mm_day") is not None:
        name = "Rate along the surface" if words_of(row, "kind") == SLIDING else "Rate"
        rows.append((say(name), with_error(row, "rate_mm_day", "rate_err", "mm/day", 3)))
    rows.append((say("Inclination"), figure(row, "slope_deg", "°", 0)))
    return rows + _heights(of.surface, row["geometry"]) + common


def _series_facts(row: Mapping[str, Any], unit: RateUnit) -> list[tuple[str, str]]:
    state = alert_state(row)
    of_heights = value_of(row, "motion_m") is not None  # the others are of the motion along the surface
    rows = [
        (say("Alert level"), "–" if state is None else state.words(say)),
        (say("Reason"), (state.reason_words(say) if state else "") or "–"),
        (say("Action"), say(words_of(row, "action"))),
        (say("Trend"), say(words_of(row, "trend"))),
        *(_along_the_surface(row, unit) if of_heights else []),
        (
            say("Velocity of the heights" if of_heights else "Velocity"),
            with_error(row, "rate_mm_day", "rate_err", unit.name, 1, scale=unit.days),
        ),
        (
            say("Latest velocity of the heights" if of_heights else "Latest velocity"),
            with_error(row, "rate_last", "rate_last_err", unit.name, 1, scale=unit.days),
        ),
        (say("Velocity class"), say(words_of(row, "velocity_class"))),
        (say("Mean change"), figure(row, "dz_mean_m", "m", sign=True)),
        (say("Area"), significant(row, "area_m2", "m²")),
        (say("Net volume"), with_error(row, "vol_net_m3", "vol_err_m3", "m³")),
        (say("Level of detection, median"), figure(row, "lod95_m", "m")),
        (say("Surveys in a row"), figure(row, "n_epochs_confirmed", digits=0)),
        (say("Seen"), say("{0} to {1}").format(words_of(row, "first_seen"), words_of(row, "last_seen"))),
        (say("Inclination"), figure(row, "slope_deg", "°", 0)),
    ]
    if words_of(row, "failure_from"):
        ends = words_of(row, "failure_from"), words_of(row, "failure_to")
        rows.append((say("Failure by inverse velocity"), say("{0} to {1}").format(*ends)))
    return rows


def _along_the_surface(row: Mapping[str, Any], unit: RateUnit) -> list[tuple[str, str]]:
    """How far and how fast a zone of a series moved along the surface, and where to."""
    velocity = with_error(row, "motion_rate_mm_day", "motion_rate_err", unit.name, 1, sign=False, scale=unit.days)
    towards = figure(row, "motion_azimuth_deg", "°", 0), figure(row, "motion_off_dip_deg", "°", 0, sign=True)
    return [
        (say("Velocity along the surface"), velocity),
        (say("Motion along the surface"), with_error(row, "motion_m", "motion_err_m", "m", 3, sign=False)),
        (say("Towards, and off the dip"), ", ".join(towards)),
    ]


def _heights(surface: Surface | None, zone: Any) -> list[tuple[str, str]]:
    """The range of the later survey's heights in a zone."""
    if surface is None or not surface.heights:
        return []
    low, high = surface.height_range(zone)
    if low is None or high is None:
        return []
    return [(say("Height of the ground"), interval({"low": low, "high": high}, "low", "high", "m", 1, sign=False))]


def _section(document: Document, of: Zones, section: Section, names: tuple[str, str], height_mm: float) -> Block:
    letter, zone_id = names
    drawn = section_drawing(section, of.epochs, letter, height_mm)
    words = say(
        f"Section {letter}–{letter}′ through {zone_id}; the zone is shaded, the ribbon is the level of detection."
    )
    return document.picture(drawn, words, caption=words)


def zone_history(
    document: Document, record: Mapping[str, Any], zone_id: str, events: Mapping[tuple[str, str], str]
) -> list[tuple[float, list[Block]]]:
    """Of a series: the zone's course as a chart, and its last surveys as a table."""
    course = (record.get("course") or {}).get(zone_id)
    if not course or not record.get("dates"):
        return []
    unit = unit_of_rates(record)
    columns = [
        Column(say("Survey"), left=True),
        Column(say("Days")),
        Column(say("Change (m)")),
        Column(say("Net volume (m³)")),
        Column(say("Rate since the survey before") + f" ({say(unit.name)})", width=27.0),
        Column(say("Level")),
        Column(say("What was seen"), left=True, wide=True),
    ]
    rows: list[list[Cell]] = [
        [
            str(survey["epoch"]),
            figure(survey, "days", digits=0),
            with_error(survey, "dz_mean_m", "dz_err_m", digits=3),
            with_error(survey, "vol_net_m3", "vol_err_m3"),
            with_error(survey, "rate_mm_day", "rate_err", digits=1, scale=unit.days),
            figure(survey, "alert_level", digits=0),
            events.get((zone_id, str(survey["epoch"])), ""),
        ]
        for survey in course[-_LAST_SURVEYS:]
    ]
    words = say(f"Mean change of {zone_id} against the first survey, with 95 % bands.")
    if has_motion(course):
        words = say(f"Mean change and motion along the surface of {zone_id} against the first survey, with 95 % bands.")
    chart = document.picture(course_drawing(course, str(record["dates"][0]), _COURSE_MM), words, caption=words)
    levels = next((one for one in levels_of(record, MOST_SHEETS) if one.zone_id == zone_id), None)
    return [(5.7, [chart]), (0, [blocks.table(columns, rows)]), *_level_history(levels)]


def _level_history(levels: ZoneLevels | None) -> list[tuple[float, list[Block]]]:
    """The surveys that changed the alert level or its state, with the reason of each change."""
    if levels is None or not levels.changes:
        return []
    columns = [Column(say("Survey"), left=True), Column(say("Level")), Column(say("State"), left=True)]
    columns.append(Column(say("Reason"), left=True, wide=True))
    rows: list[list[Cell]] = [
        [change.day, str(change.level), say(change.state), say(change.reason)]
        for change in levels.changes[-_LAST_CHANGES:]
    ]
    title = say("History of the alert level")
    if len(levels.changes) > _LAST_CHANGES:
        title = say(f"History of the alert level, the last {_LAST_CHANGES} of {len(levels.changes)} changes")
    return [(0, [blocks.heading(title, 2), blocks.table(columns, rows)])]


def _motion_of(vectors: NDArray[np.float64], zone: Any) -> str:
    """A sentence on the vectors in a zone."""
    if not len(vectors):
        return ""
    inside = shapely.contains_xy(zone.buffer(0.5), vectors[:, 0], vectors[:, 1])
    lengths = np.hypot(*vectors[inside, 2:].T)
    if not lengths.size:
        return ""
    return say(
        f"Motion along the surface: {len(lengths)} vectors in the zone, median {np.median(lengths):.3f} m, largest "
        f"{lengths.max():.3f} m on the map."
    )


def review_blocks(document: Document, review: Review | None) -> list[Block]:
    """The review with its photo; what a visit on site is to enter where there is none."""
    if review is None:
        empty = [(say("Visited on"), ""), (say("by"), ""), (say("Finding"), "")]
        return [blocks.heading(say("Review"), 2), blocks.facts(empty, 3)]
    head = say(review.status.capitalize())
    remarks = review.remarks
    while text_width(remarks) > _MAX_REMARKS:
        remarks = f"{remarks[: _MAX_REMARKS * len(remarks) // text_width(remarks) - 2]} …"
    entries = [(say("Review"), head), (say("Reviewer"), review.reviewer), (say("Date"), review.date)]
    words = [blocks.facts(entries, 1), blocks.paragraph(remarks or review.photo_fault)]
    if review.photo is None:
        return [blocks.heading(say("Review"), 2), blocks.facts(entries, 3), *words[1:]]
    photo = document.picture(content_of(review.photo), review.photo.text, height=46.0)
    return [blocks.heading(say("Review"), 2), blocks.side_by_side(words, [photo], 0.55)]


def content_of(picture: Picture) -> bytes:
    """The bytes of a picture of the HTML report."""
    return base64.b64decode(picture.source.partition(",")[2])
