"""A sheet for each slope of a corridor that asks for attention: its map, figures, zones and alerts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas as gpd

from ....interface.input_files import RUN_TABLE
from ....interface.language import current_language
from ....interface.rates import rate_unit
from ...core.errors import InputError
from ...core.input_files import read_input
from ...core.progress import Progress
from ..compose import REPORT, read_record
from ..figures_in_text import figure, percent, say, value_of
from . import blocks, parts
from .blocks import Block, Cell, Column, Document
from .details import chainage_text
from .maps import slope_map
from .page_words import PageWords, page_words
from .rasters import surface_of
from .sections import section_drawing, zone_sections
from .sheets import review_blocks, zone_history
from .source import Source, map_layers, read_source

MOST_SHEETS = 12
_MOST_ZONES, _MOST_ALERTS = 5, 5
_MAP_MM, _SECTION_MM = (98.0, 104.0), 58.0
_SOURCES = {"change": "zones", "series": "zones", "screening": "screened"}
_PAGE_CHARACTERS = 200_000_000
_LETTER = "A"


def slope_sheets(
    document: Document,
    done: Sequence[Any],
    folders: Mapping[str, Path],
    tables: tuple[gpd.GeoDataFrame, gpd.GeoDataFrame],
    progress: Progress,
) -> dict[str, Block]:
    """The sheets of the first ``MOST_SHEETS`` slopes that ask for attention, by slope.

    Args:
        done: slopes with the fields of ``ranking.Ranked``, the most urgent first.
        folders: of their results, by slope.
        tables: zones and open alerts of the corridor.
    """
    made: dict[str, Block] = {}
    asking = [slope for slope in done if slope.attention > 0][:MOST_SHEETS]
    for number, slope in enumerate(asking):
        progress.update(number / len(asking), f"drawing the sheet of {slope.slope}")
        try:
            source = _source(folders[slope.slope])
        except (KeyError, InputError) as error:
            why = str(error) if isinstance(error, InputError) else "its folder is not known."
            progress.warning(f"{slope.slope} has no sheet in the report of the corridor: {why}")
            continue
        zones, alerts = (_of_slope(table, slope.slope) for table in tables)
        made[slope.slope] = _sheet(document, source, slope, zones, alerts)
    return made


def slope_label(slope: str) -> str:
    """What links lead to."""
    return f"slope-{slope.encode('utf-8', 'backslashreplace').hex()}"


def _source(folder: Path) -> Source:
    """The folder of a slope with the words of its page, if that is in the language of this one.

    Raises:
        InputError: it holds no record of a run that has a report, or a table that cannot be read.
    """
    record = read_record(folder)
    path, words = folder / REPORT, PageWords()
    language = f'lang="{current_language().replace("_", "-")}"'
    if path.is_file() and path.stat().st_size < _PAGE_CHARACTERS:
        page = read_input(path, RUN_TABLE).decode("utf-8", errors="replace")
        if language in page[:200]:
            words = page_words(page)
    return read_source(record, folder, words)


def _of_slope(table: gpd.GeoDataFrame, slope: str) -> gpd.GeoDataFrame:
    return table[table["slope"] == slope] if "slope" in table else table.iloc[:0]


def _sheet(document: Document, source: Source, slope: Any, zones: gpd.GeoDataFrame, alerts: gpd.GeoDataFrame) -> Block:
    of_zones = source.screened if source.is_screening else source.zones
    wanted = _asking(zones, source)
    shown = of_zones[of_zones["zone_id"].isin(wanted)]
    surface = surface_of(source.record, source.folder)
    layers, drawn = map_layers(source), b""
    if surface is not None and len(shown):
        (section,) = zone_sections(surface, shown.iloc[:1])
        layers = replace(layers, lines=[(_LETTER, section.line)])
        drawn = section_drawing(section, source.ends, _LETTER, _SECTION_MM)
    picture = parts.screened_slope(source, layers, _MAP_MM) if source.is_screening else b""
    picture = picture or slope_map(surface, layers, *_MAP_MM)
    facts = [blocks.facts(_facts(source, slope), 1, gap=2.4)]
    rows: list[tuple[float, list[Block]]] = [
        (0, [blocks.heading(f"{slope.slope}: {say(f'attention {slope.attention}')}", 1, slope_label(slope.slope))])
    ]
    if source.words.verdict:
        rows.append((0, [{"kind": "verdict", "text": source.words.verdict}]))
    if picture:
        left = [document.picture(picture, say("Map of the slope with its zones"))]
        rows.append((10.0, [blocks.side_by_side(left, facts, 0.56, high=True)]))
    else:
        rows.append((0, facts))
    if len(shown):
        rows += _first_zone(document, source, str(shown.iloc[0]["zone_id"]), drawn)
        table = parts.screened_table if source.is_screening else lambda z: parts.zone_table(source, z, links=False)
        rows.append((0, [table(shown.iloc[:_MOST_ZONES]), *_rest(len(wanted) - _MOST_ZONES)]))
    rows.append((0, _alerts(alerts)))
    if len(shown):
        reviews = source.screened_reviews if source.is_screening else source.reviews
        review = reviews.get(str(shown.iloc[0]["zone_id"]))
        # its photo is on the zone's sheet in the report of the slope
        rows.append((0, review_blocks(document, None if review is None else replace(review, photo=None))))
    if not (source.is_series and picture):
        rows.append((1.6, [blocks.lines()]))
    return blocks.sheet(rows, gap=3.0)


def _asking(zones: gpd.GeoDataFrame, source: Source) -> list[str]:
    """Ids, in the slope's own table, of its zones that ask for attention."""
    wanted = "screening" if source.is_screening else "series" if source.is_series else "change"
    asking = zones[(zones["source"] == wanted) & (zones["attention"].fillna(0) > 0)]
    return [str(name).rpartition("/")[2] for name in asking["zone_id"]]


def _first_zone(document: Document, source: Source, zone_id: str, drawn: bytes) -> list[tuple[float, list[Block]]]:
    """Of a series the course of the first zone, else its section."""
    course = zone_history(document, source.record, zone_id, source.events)
    if course:
        return course
    if not drawn:
        return []
    words = say(
        f"Section {_LETTER}–{_LETTER}′ through {zone_id}; the zone is shaded, the ribbon is the level of detection."
    )
    return [(7.0, [document.picture(drawn, words, caption=words)])]


def _rest(count: int) -> list[Block]:
    if count <= 0:
        return []
    return [
        blocks.paragraph(say(f"{count} more zones ask for attention; they are in the report of the slope."), small=True)
    ]


def _facts(source: Source, slope: Any) -> list[tuple[str, str]]:
    values = {name: getattr(slope, name) for name in ("rate_mm_day", "volume_m3", "largest_m")}
    metrics, unit = source.record["metrics"], rate_unit([slope.rate_mm_day])
    surveys = list(source.surveys)
    days = ", ".join(surveys) if len(surveys) <= 4 else say(f"{len(surveys)} from {surveys[0]} to {surveys[-1]}")
    place = slope.location or ("" if slope.chainage is None else chainage_text(slope.chainage))
    rows = [
        (say("Surveys"), days),
        (say("First zone on the road"), place or "–"),
        (say("Zones"), str(slope.zones)),
        (say("Open alerts"), str(slope.open_alerts)),
        (say("Fastest zone"), figure(values, "rate_mm_day", unit.name, 1, sign=True, scale=unit.days)),
        (say("Largest volume"), figure(values, "volume_m3", "m³", 2, sign=True)),
        (say("Largest height"), figure(values, "largest_m", "m", 2, sign=True)),
    ]
    if value_of(metrics, "lod_median_m") is not None:
        rows.append((say("Level of detection, median"), figure(metrics, "lod_median_m", "m")))
    if value_of(metrics, "compared_share") is not None:
        rows.append((say("Slope compared"), percent(metrics, "compared_share")))
    if slope.report:
        rows.append((say("Its own report"), slope.report))
    return rows


def _alerts(alerts: gpd.GeoDataFrame) -> list[Block]:
    if not len(alerts):
        return []
    more = len(alerts) - _MOST_ALERTS
    return [
        blocks.heading(say("Open alerts"), 2),
        alert_table(alerts.iloc[:_MOST_ALERTS], with_slope=False),
        *([blocks.paragraph(say(f"{more} more are in the table of open alerts."), small=True)] if more > 0 else []),
    ]


def alert_table(alerts: gpd.GeoDataFrame, *, with_slope: bool = True) -> Block:
    """Open alerts with their reason and state, and what people said of it."""
    columns = [Column(say("Slope"), left=True)] if with_slope else []
    columns += [Column(say("Zone"), left=True), Column(say("Attention"))]
    records = alerts.to_dict("records")
    placed, said = (any(_text(alert, name) for alert in records) for name in ("location", "state_reason"))
    columns += [Column(say("Reason"), left=True, wide=True)]
    columns += [Column(say("On the road"), left=True, width=43.0)] if placed else []
    columns += [Column(say("Raised on"), left=True), Column(say("State"), left=True, width=28.0 if said else 0.0)]
    columns += [Column(say("By"), left=True)]
    rows: list[list[Cell]] = []
    for alert in records:
        # ids of zones begin with their slope, which stands before, or above
        zone = str(alert["zone_id"]).removeprefix(f"{alert['slope']}/").rpartition("/")[2]
        row: list[Cell] = [
            zone, figure(alert, "attention", digits=0), say(_text(alert, "reason")),
            *([_text(alert, "location")] if placed else []),
            _text(alert, "raised_on"), _state(alert), _text(alert, "reviewer"),
        ]  # fmt: skip
        rows.append([str(alert["slope"]), *row] if with_slope else row)
    return blocks.table(columns, rows)


def _text(alert: Mapping[str, Any], name: str) -> str:
    value = alert.get(name)
    return value if isinstance(value, str) else ""


def _state(alert: Mapping[str, Any]) -> str:
    """The state, and why people set it."""
    state, why = _text(alert, "state"), _text(alert, "state_reason")
    state = "alert raised" if state == "raised" else state
    return f"{say(state)}: {why}" if why else say(state)
