"""Parts of the report to sign: the first page, tables of zones, screened zones, pictures, limits, signatures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import geopandas as gpd

from ....interface.alert_states import alert_state
from ....interface.rates import RateUnit
from ...zones.fields import SLIDING
from ..embedding import Picture, photograph
from ..figures_in_text import figure, interval, say, significant, with_error, words_of
from ..record_shape import inside
from ..reviews import Review
from ..series_words import unit_of_rates
from . import blocks
from .blocks import Block, Cell, Column, Document
from .details import LABELS, Details, place_text
from .maps import MapLayers, slope_map
from .motion_sheets import first_zones
from .page_words import PageWords
from .screened_relief import LOWERED, RAISED, screened_relief
from .sheets import MOST_SHEETS, content_of, sheet_label
from .source import Source

_MAP_WIDTH_MM, _LEAST_MAP_MM, _MOST_MAP_MM, _ROW_MM = 176.0, 95.0, 158.0, 5.3
_FIRST_PAGE_ROWS = 6
_MOST_ROWS = 60
_SIGNATURES_MM, _LINES_MM = 50.0, 30.0  # at least, of the fields for signatures, and of lines with their heading
_MOST_DAYS = 6
_ZONE_FIGURES = (("Mean change (m)", 15.0), ("Area (m²)", 13.5), ("Net volume (m³)", 23.0))
_OBJECT_FIGURES = (("height_m", 2), ("length_m", 1), ("width_m", 1), ("volume_m3", 2))
_RATE_MM = 25.0
"""Columns of the table of zones, with their millimetres."""
_PICTURE_MM = 100.0
"""With its heading less than half a page, so that a page which it has no room on is at least half full."""


def map_size(source: Source) -> tuple[float, float]:
    """Millimetres that the first page has for its map."""
    rows = min(len(source.screened if source.is_screening else source.zones), _FIRST_PAGE_ROWS)
    return _MAP_WIDTH_MM, max(_LEAST_MAP_MM, _MOST_MAP_MM - _ROW_MM * rows)


def first_page(document: Document, source: Source, picture: bytes) -> Block:
    """Title, details, verdict, main figures, map and the first zones."""
    details, words = source.details, source.words
    names = ("slope_name", "report_route", "client", "chainage_range", "author", "checker")
    rows = [(say(LABELS[name]), details[name]) for name in names]
    system = source.record.get("reference_system")
    rows += [
        *([(say("Reference system"), system_words(system))] if system else []),
        (say("Surveys"), _days(source.surveys)),
        (say("Made"), f"{str(source.record['started'])[:10]}, {source.record['software']}"),
    ]
    parts: list[tuple[float, list[Block]]] = [
        (0, [title(words.kind, details["slope_name"] or words.title)]),
        (0, [blocks.facts(rows)]),
    ]
    if words.verdict:
        parts.append((0, [{"kind": "verdict", "text": words.verdict}]))
    if words.cards:
        parts.append((0, [{"kind": "cards", "rows": [list(card) for card in words.cards]}]))
    if source.is_screening:
        parts.append((0, [blocks.paragraph(text, small=True) for text in _screened_how(source.record)]))
    zones, screening = (source.screened, True) if source.is_screening else (source.zones, False)
    shown = min(len(zones), _FIRST_PAGE_ROWS)
    if picture:
        parts.append((1.0, [document.picture(picture, say("Map of the slope with its zones"))]))
    if shown:
        made = screened_table(zones.iloc[:shown]) if screening else zone_table(source, zones.iloc[:shown])
        parts.append((0, [made]))
        if len(zones) > shown:
            parts.append((0, [blocks.paragraph(say(f"All {len(zones)} zones are in the table below."), small=True)]))
    if source.is_motion:
        parts.append((0, first_zones(source.record.get("displacement") or {})))
    if not picture and not shown:
        parts.append((1.0, [blocks.lines()]))
    return blocks.sheet(parts, gap=3.0)


def system_words(system: Mapping[str, Any]) -> str:
    """Name and number of a reference system."""
    return f"{system['name']} (EPSG:{system['epsg']})" if system.get("epsg") else str(system["name"])


def _days(surveys: Sequence[str]) -> str:
    if len(surveys) <= _MOST_DAYS:
        return ", ".join(surveys)
    return say(f"{len(surveys)} from {surveys[0]} to {surveys[-1]}")


def title(sort: str, text: str) -> Block:
    return {"kind": "title", "sort": sort, "text": text}


def zone_table(source: Source, zones: gpd.GeoDataFrame, *, links: bool = True) -> Block:
    """The zones with their main figures; ids lead to the sheets."""
    unit = unit_of_rates(source.record) if source.is_series else RateUnit("mm/day", 1.0)
    series, road = source.is_series, any(place_text(row) for row in zones.to_dict("records"))
    columns = [
        Column(say("Zone"), left=True),
        Column(say("Kind"), left=True),
        Column(say("Alert") if series else say("Severity"), left=True, wide=not road),
        *(Column(say(words), width=width) for words, width in _ZONE_FIGURES),
        Column(f"{say('Rate')} ({say(unit.name)})", width=_RATE_MM),
        *([Column(say("On the road"), left=True, wide=True)] if road else []),
        Column(say("Review"), left=True),
    ]
    rows: list[list[Cell]] = []
    for number, row in enumerate(zones.to_dict("records")):
        name, kind = words_of(row, "zone_id"), words_of(row, "kind")
        state = alert_state(row) if series else None
        grade = "" if state is None else state.short(say)
        review = source.reviews.get(name)
        rows.append(
            [
                blocks.linked(name, sheet_label(name)) if links and number < MOST_SHEETS else name,
                blocks.marked(say(kind), kind),
                grade or say(words_of(row, "severity")),
                figure(row, "dz_mean_m", sign=True),
                significant(row, "area_m2") if series else figure(row, "area_m2", digits=2),
                with_error(row, "vol_net_m3", "vol_err_m3"),
                _rate(row, unit, series=series),
                *([place_text(row)] if road else []),
                say(review.status) if review else "–",
            ]
        )
    slides = any(words_of(row, "kind") == SLIDING for row in zones.to_dict("records"))
    return blocks.table(columns, rows, say("The rate of a sliding zone is that along the surface.") if slides else "")


def _rate(row: Mapping[str, Any], unit: RateUnit, *, series: bool) -> str:
    """Of ground that slid that along the surface, which of a pair of surveys stands in the same column."""
    if series and words_of(row, "kind") == SLIDING:
        return with_error(row, "motion_rate_mm_day", "motion_rate_err", digits=1, sign=False, scale=unit.days)
    return with_error(row, "rate_mm_day", "rate_err", digits=1 if series else 3, scale=unit.days)


def more_zones(source: Source) -> list[Block]:
    """All zones in one table, where the first page has not room for them; and what was reviewed of those without a
    sheet.
    """
    if source.is_screening or len(source.zones) <= _FIRST_PAGE_ROWS:
        return []
    made = [blocks.heading(say("All zones")), zone_table(source, source.zones.iloc[:_MOST_ROWS])]
    if len(source.zones) > _MOST_ROWS:
        rest = len(source.zones) - _MOST_ROWS
        made.append(
            blocks.paragraph(say(f"The other {rest} zones are in the table of zones of the folder."), small=True)
        )
    return made + _other_reviews(source.zones.iloc[MOST_SHEETS:], source.reviews)


def objects_above(source: Source) -> list[Block]:
    """What appeared or vanished above the ground, vegetation aside."""
    objects = source.record.get("objects") or []
    if not objects:
        return []
    words = ("Object", "Kind", "Change")
    names = (*words, "Height (m)", "Length (m)", "Width (m)", "Volume (m³)", "95 % range (m³)", "Zone", "Place (x, y)")
    columns = [Column(say(name), left=name in words) for name in names]
    rows: list[list[Cell]] = [
        [
            row["object_id"],
            say(row["kind"]),
            say(row["change"]),
            *(figure(row, name, digits=digits) for name, digits in _OBJECT_FIGURES),
            interval(row, "volume_low_m3", "volume_high_m3", sign=False),
            row["zone_id"] or "–",
            f"{row['x']:.1f}, {row['y']:.1f}",
        ]
        for row in objects[:_MOST_ROWS]
    ]
    note = say("An object in a zone names it: the zone’s volume holds it already. New boulders and heaps are deposits.")
    made = [blocks.heading(say("Objects above the ground")), blocks.table(columns, rows, size=7.0)]
    return [*made, blocks.paragraph(note, small=True)]


def _other_reviews(zones: gpd.GeoDataFrame, reviews: Mapping[str, Review]) -> list[Block]:
    rows: list[list[Cell]] = [
        [r.zone_id, say(r.status), r.reviewer, r.date, r.remarks]
        for name in zones["zone_id"]
        if (r := reviews.get(str(name))) is not None
    ]
    if not rows:
        return []
    return [blocks.heading(say("Reviews of zones without a sheet"), 2), _review_table(rows)]


def _review_table(rows: Sequence[Sequence[Cell]]) -> Block:
    names = [say(name) for name in ("Zone", "Review", "Reviewer", "Date", "Remarks")]
    return blocks.table([Column(name, left=True, wide=name == names[-1]) for name in names], rows)


def screened_table(zones: gpd.GeoDataFrame) -> Block:
    """Screened zones with their main figures."""
    compared = "confirmed" in zones
    columns = [
        Column(say("Zone"), left=True),
        Column(say("Kind"), left=True),
        Column(say("Confidence"), left=True),
        Column(say("Probability")),
        Column(say("Height (m)")),
        Column(say("95th perc. (m)")),
        Column(say("Area (m²)")),
        *([Column(say("The change"), left=True), Column(say("Its mean (m)"))] if compared else []),
        Column(say("Place (x, y)")),
    ]
    rows: list[list[Cell]] = []
    for row in zones.to_dict("records"):
        kind, point = words_of(row, "kind"), row["geometry"].representative_point()
        rows.append(
            [
                words_of(row, "zone_id"),
                blocks.marked(say(kind), kind),
                say(words_of(row, "confidence")),
                figure(row, "probability", digits=2),
                figure(row, "height_med_m", sign=True),
                figure(row, "height_p95_m", sign=True),
                figure(row, "area_m2", digits=2),
                *([say(words_of(row, "confirmed")), figure(row, "dz_signif_m", sign=True)] if compared else []),
                f"{point.x:.1f}, {point.y:.1f}",
            ]
        )
    return blocks.table(columns, rows, size=6.4 if compared else 7.0)


def screened(document: Document, source: Source) -> list[Block]:
    """The screened zones of the last survey: table, picture, reviews with their photos."""
    record = source.record
    if "screened_zone_count" not in record["metrics"]:
        return []
    made = [blocks.heading(say("Screened zones of the last survey"))]
    made += [] if source.is_screening else [blocks.paragraph(text) for text in _screened_how(record)]
    if not len(source.screened):
        return [*made, blocks.paragraph(say("No ground looks raised or lowered by its shape."))]
    words = say("Where the ground looks raised or lowered by its shape alone; these are shapes, not movement.")
    made += [blocks.paragraph(words), screened_table(source.screened.iloc[:_MOST_ROWS])]
    drawn = _screened_map(source)
    if drawn is not None:
        made.append(_as_wide_as_the_page(document, drawn))
    rows: list[list[Cell]] = [
        [r.zone_id, say(r.status), r.reviewer, r.date, r.remarks] for r in source.screened_reviews.values()
    ]
    return [*made, *([_review_table(rows)] if rows else []), *_photos(document, source.screened_reviews)]


def _screened_how(record: Mapping[str, Any]) -> list[str]:
    """What the screening can find, and what it found of hazards that were put in."""
    return [say(str(record[name])) for name in ("detectable", "self_test") if record.get(name)]


def screened_slope(source: Source, layers: MapLayers, size_mm: tuple[float, float]) -> bytes:
    """The map of a screening: relief of its ground with what was labelled, and the zones; where the cloud cannot be
    read, the map that the screening drew. Empty where there is none.
    """
    path = inside(source.folder, str(source.record["outputs"].get("screened", "")))
    relief = screened_relief(path) if path is not None and path.is_file() else None
    if relief is not None:
        marked = (("labelled raised", RAISED), ("labelled lowered", LOWERED))
        return slope_map(relief, replace(layers, marked=marked), *size_mm)
    drawn = _screened_map(source)
    return b"" if drawn is None else content_of(drawn)


def _screened_map(source: Source) -> Picture | None:
    path = inside(source.folder, str(source.record["outputs"].get("screened_map", "")))
    return photograph(path, say("Screened zones over the last survey’s ground."), 1000) if path else None


def _photos(document: Document, reviews: Mapping[str, Review]) -> list[Block]:
    made = [
        document.picture(content_of(r.photo), r.photo.text, height=55.0, caption=r.photo.text)
        for r in reviews.values()
        if r.photo is not None
    ]
    pairs = [made[i : i + 2] for i in range(0, len(made), 2)]
    return [blocks.side_by_side(pair[:1], pair[1:]) for pair in pairs]


def pictures(document: Document, source: Source) -> list[Block]:
    """The picture that a run draws of the whole slope."""
    drawn = _whole_slope(source)
    if drawn is None:
        return []
    return [blocks.heading(say("The slope from above")), _as_wide_as_the_page(document, drawn)]


def whole_slope(source: Source) -> bytes:
    """The same picture alone; empty where there is none."""
    drawn = _whole_slope(source)
    return b"" if drawn is None else content_of(drawn)


def _whole_slope(source: Source) -> Picture | None:
    name, words = "series.png", "Map of the velocity of each cell, with the zones in the colours of their alert levels"
    if source.is_face:
        name, words = "m3c2_face.png", "Distances on the face, seen square to its plane"
    elif not source.is_series:
        name, words = "heatmap.png", "The change, half-transparent over the later survey from above"
    return photograph(source.folder / name, say(words), 1000)


def _as_wide_as_the_page(document: Document, drawn: Picture) -> Block:
    height = min(_PICTURE_MM, _MAP_WIDTH_MM * drawn.height / drawn.width)
    return document.picture(content_of(drawn), drawn.text, height=height, caption=drawn.text)


def limits(words: PageWords) -> list[Block]:
    """What the run cannot tell, and its warnings, as the page has them."""
    made: list[Block] = []
    if words.limits:
        made += [blocks.heading(say("What this cannot tell you")), blocks.terms(words.limits)]
    if words.warnings:
        made.append({"kind": "warning", "title": say("Warnings"), "rows": words.warnings})
    return made


def closing(details: Details) -> list[Block]:
    """Remarks, actions and the fields for signatures, which fill the rest of the last page.

    What was given of remarks and actions stands before; there are lines for what was not.
    """
    people = [
        (say("Prepared by"), details["author"]),
        (say("Checked by"), details["checker"]),
        (say("Approved by"), ""),
    ]
    signatures = {
        "kind": "signatures", "rows": [list(row) for row in people], "name": say("Name"), "sign": say("Signature"),
        "date": say("Date"),
    }  # fmt: skip
    told: list[Block] = []
    rest: list[tuple[float, list[Block]]] = []
    for words, text in ((say("Remarks"), details["report_remarks"]), (say("Actions"), details["actions"])):
        if text:
            told += [blocks.heading(words, 2), blocks.paragraph(text)]
        else:
            rest += [(0, [blocks.heading(words, 2)]), (1.0, [blocks.lines()])]
    title_of_all = [blocks.heading(say("Remarks, actions and signatures"))]
    if told:
        told = title_of_all + told
    else:
        rest.insert(0, (0, title_of_all))
    least = _SIGNATURES_MM + _LINES_MM * sum(1 for share, _ in rest if share)
    rest = rest or [(1.0, [blocks.lines()])]
    return [*told, blocks.rest_of_page([*rest, (0, [signatures])], least)]
