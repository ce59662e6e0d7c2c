"""The report to sign of a corridor: its slopes in the order in which they should be looked at."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import geopandas as gpd
from shapely.geometry.base import BaseGeometry

from ....interface.rates import RateUnit, rate_unit
from ...core.progress import Progress
from ...core.version import VERSION
from ..corridor_alerts import withdrawn_of
from ..figures_in_text import figure, say
from . import blocks, parts
from .blocks import Block, Cell, Column, Document
from .corridor_pictures import Span, corridor_map, road_strip, strip_height
from .details import FLIGHT, LABELS, Details, chainage_text, details_of
from .slope_sheets import alert_table, slope_label, slope_sheets
from .write import save, say_missing

_FIRST_PAGE_ROWS, _FIRST_PAGE_ALERTS = 6, 5
_NUMBERS = (
    "Attention",
    "Open alerts",
    "Zones",
    "Fastest",
    "Largest volume (m³)",
    "Largest height (m)",
    "Chainage",
    "Surveys",
)
_NUMBER_MM = 15.5
_MAP_WIDTH_MM, _MAP_MM, _LEAST_MAP_MM, _ROW_MM = 176.0, 160.0, 60.0, 5.3
_GRADES = ("high", "moderate", "medium", "low", "unsure")
_ACTING = 2  # attention from which a slope is counted in the verdict
_PEOPLE = ("slope_name", "report_route", "client", "chainage_range", "author", "checker")


@dataclass(frozen=True)
class SignedCorridor:
    """Slopes ``done`` with the fields of ``ranking.Ranked`` of the batch, slope and sentence of those that ``failed``,
    the tables of ``zones`` and of open ``alerts``, the ``regions`` of the slopes by name, and the manifest's name.

    ``spans`` are the places of slopes on their roads, ``folders`` those of the slopes' results, for their sheets.
    """

    done: Sequence[Any]
    failed: Sequence[tuple[str, str]]
    zones: gpd.GeoDataFrame
    alerts: gpd.GeoDataFrame
    regions: Sequence[tuple[str, BaseGeometry]]
    manifest: str
    spans: Sequence[Span] = ()
    folders: Mapping[str, Path] = field(default_factory=dict)


def write_corridor_pdf(
    path: Path, corridor: SignedCorridor, details: Mapping[str, Any], started: str, progress: Progress
) -> None:
    """Write the PDF of a corridor.

    Args:
        details: as a run record has them.
        started: the time of the run, as in its record.

    Raises:
        InputError: the details do not fit, or what makes a PDF is missing.
    """
    flights = dict.fromkeys(FLIGHT, "")  # the slopes' own reports have them, one for each of their surveys
    found = details_of({"parameters": {"details": {**details, **flights}}}, ("",), (corridor.zones,))
    record = {"software": f"SlopeWatch {VERSION}", "started": started}
    title = details.get("slope_name") or say("Corridor report")
    save(corridor_document(corridor, found, started, progress), path, found, str(title), record)
    say_missing([_label(name) for name in _PEOPLE if not found[name]], progress, path.name)


def corridor_document(
    corridor: SignedCorridor, details: Details, started: str, progress: Progress | None = None
) -> Document:
    """First page with map, most urgent slopes and alerts; a sheet for each slope that asks for attention; all slopes,
    all alerts, what failed, what attention means, signatures.
    """
    document = Document()
    sheets = slope_sheets(
        document, corridor.done, corridor.folders, (corridor.zones, corridor.alerts), progress or Progress()
    )
    document.blocks.append(_first_page(document, corridor, details, started, sheets))
    document.blocks += sheets.values()
    document.blocks += [
        blocks.heading(say("All slopes, what asks for most attention first")),
        _slopes(corridor.done, sheets),
    ]
    document.blocks += _alerts(corridor.alerts) + _withdrawn(corridor.zones) + _failed(corridor.failed) + _meanings()
    document.blocks += parts.closing(details)
    return document


def _first_page(
    document: Document, corridor: SignedCorridor, details: Details, started: str, linked: Collection[str]
) -> Block:
    shown, urgent = corridor.done[:_FIRST_PAGE_ROWS], corridor.alerts.iloc[:_FIRST_PAGE_ALERTS]
    rows = [(say(_label(name)), details[name]) for name in _PEOPLE]
    rows += [(say("Manifest"), corridor.manifest), (say("Made"), f"{started[:10]}, SlopeWatch {VERSION}")]
    first: list[tuple[float, list[Block]]] = [
        (0, [parts.title(say("Corridor report"), details["slope_name"] or say("Slopes of a corridor"))]),
        (0, [blocks.facts(rows)]),
        (0, [{"kind": "verdict", "text": _verdict(corridor)}]),
        (0, [{"kind": "cards", "rows": _cards(corridor)}]),
    ]
    strip = strip_height(corridor.spans)
    high = _MAP_MM - _ROW_MM * (len(shown) + (len(urgent) + 3 if len(urgent) else 0)) - strip
    attentions = {slope.slope: slope.attention for slope in corridor.done}
    size = _MAP_WIDTH_MM, max(high, _LEAST_MAP_MM)
    picture = corridor_map(corridor.zones, corridor.regions, attentions, corridor.spans, size)
    if picture:
        first.append((1.0, [document.picture(picture, say("Map of the corridor with its slopes and zones"))]))
    if strip:
        drawn = road_strip(corridor.spans, _MAP_WIDTH_MM)
        first.append((0, [document.picture(drawn, say("Slopes at their chainages"), height=strip)]))
    first.append((0, [_slopes(shown, linked)]))
    if len(urgent):
        first.append((0, [blocks.heading(say("Open alerts, the highest attention first"), 2), alert_table(urgent)]))
    left_out = len(corridor.done) > len(shown) or len(corridor.alerts) > len(urgent)
    if left_out:
        first.append((0, [blocks.paragraph(say("All slopes and alerts are in the tables at the end."), small=True)]))
    if not picture:
        first.append((1.0, [blocks.lines()]))
    return blocks.sheet(first, gap=2.5)


def _label(name: str) -> str:
    return "Corridor" if name == "slope_name" else LABELS[name]


def _verdict(corridor: SignedCorridor) -> str:
    urgent = sum(1 for slope in corridor.done if slope.attention >= _ACTING)
    found = say(
        f"Slopes looked at: {len(corridor.done)}; with an attention of 2 or more: {urgent}; "
        f"open alerts: {len(corridor.alerts)}."
    )
    first = corridor.done[0] if corridor.done else None
    more = []
    if first is not None and first.attention > 0:
        more.append(say(f"{first.slope} asks for most attention ({first.attention})."))
    elif first is not None:
        more.append(say("No zone asks for attention; that is no statement on the stability of the slopes."))
    if corridor.failed:
        more.append(say(f"Not computed: {len({slope for slope, _ in corridor.failed})}; nothing is known of those."))
    return " ".join([found, *more])


def _cards(corridor: SignedCorridor) -> list[list[str]]:
    """Name, figure and a note: states of slopes, zones by severity, alerts by state."""
    failed = len({slope for slope, _ in corridor.failed})
    highest = max((slope.attention for slope in corridor.done), default=0)
    acknowledged = int(corridor.alerts["state"].astype(str).str.strip().str.lower().eq("acknowledged").sum())
    return [
        [say("Slopes done"), str(len(corridor.done)), say(f"not computed: {failed}")],
        [say("Zones"), str(len(corridor.zones)), _severities(corridor.zones)],
        [say("Open alerts"), str(len(corridor.alerts)), say(f"of these acknowledged: {acknowledged}")],
        [say("Highest attention"), str(highest), say("of all slopes")],
    ]


def _severities(zones: gpd.GeoDataFrame) -> str:
    """How many zones have which severity, alert or, if screened, confidence."""
    if not len(zones) or "source" not in zones:
        return ""
    of_change = zones[zones["source"] == "change"]["severity"].astype(str)
    found = [f"{say(grade)} {n}" for grade in _GRADES if (n := int(of_change.eq(grade).sum()))]
    series = zones[zones["source"] == "series"]["alert"].astype(str)
    found += [f"{say(alert)} {n}" for alert, n in series.value_counts(sort=False).items() if alert]
    screened = int(zones["source"].eq("screening").sum())
    return ", ".join(found + ([f"{say('by shape')} {screened}"] if screened else []))


def _meanings() -> list[Block]:
    rows = [
        (
            say("Attention"),
            say(
                "Of a series the alert level of its highest zone. Of a change 2 for a zone of high severity and 1 for "
                "a moderate one. Of one survey 1 for a screened zone of high confidence, since its shape may be old."
            ),
        ),
        (
            say("Order of the slopes"),
            say(
                "By attention, then by open alerts, the rate of the fastest zone and the largest volume. It is no "
                "measure of danger."
            ),
        ),
        (
            say("Alerts"),
            say(
                "Raised when a zone asks for attention, and open until people or a later survey close them. State and "
                "reason are entered in the layer alerts of corridor.gpkg."
            ),
        ),
        (
            say("What this cannot tell you"),
            say(
                "A slope at the end of the table showed no change above the level of detection; that is no statement "
                "about its stability. Each slope has a report of its own with its thresholds and limits."
            ),
        ),
    ]
    return [blocks.heading(say("Thresholds explained")), blocks.terms(rows)]


def _heading(words: str, unit: RateUnit) -> str:
    return f"{say(words)} ({say(unit.name)})" if words == "Fastest" else say(words)


def _slopes(done: Sequence[Any], linked: Collection[str]) -> Block:
    unit = rate_unit(slope.rate_mm_day for slope in done)
    columns = [
        Column(say("Slope"), left=True, wide=True),
        *(Column(_heading(words, unit), width=_NUMBER_MM) for words in _NUMBERS),
        Column(say("Last survey")),
    ]
    rows: list[list[Cell]] = []
    for slope in done:
        values = {name: getattr(slope, name) for name in ("rate_mm_day", "volume_m3", "largest_m")}
        rows.append(
            [
                blocks.linked(slope.slope, slope_label(slope.slope)) if slope.slope in linked else slope.slope,
                str(slope.attention),
                str(slope.open_alerts),
                str(slope.zones),
                figure(values, "rate_mm_day", digits=1, sign=True, scale=unit.days),
                figure(values, "volume_m3", digits=2, sign=True),
                figure(values, "largest_m", digits=2, sign=True),
                "–" if slope.chainage is None else chainage_text(slope.chainage),
                str(slope.surveys),
                slope.last_day,
            ]
        )
    return blocks.table(columns, rows, size=7.2)


def _alerts(alerts: gpd.GeoDataFrame) -> list[Block]:
    return [blocks.heading(say("Open alerts")), alert_table(alerts)] if len(alerts) else []


def _withdrawn(zones: gpd.GeoDataFrame) -> list[Block]:
    """The zones whose alert the last survey withdrew, with the words of their own reports."""
    rows: list[list[Cell]] = [
        [row["slope"], row["zone_id"].rpartition("/")[2], row["level"], row["reason"]] for row in withdrawn_of(zones)
    ]
    names = ("Slope", "Zone", "Level of the zone", "Reason")
    columns = [Column(say(name), left=True, wide=name == names[-1]) for name in names]
    return [blocks.heading(say("Withdrawn alerts")), blocks.table(columns, rows)] if rows else []


def _failed(failed: Sequence[tuple[str, str]]) -> list[Block]:
    if not failed:
        return []
    columns = [Column(say("Slope"), left=True), Column(say("Why"), left=True, wide=True)]
    rows: list[list[Cell]] = [[slope, say(sentence)] for slope, sentence in failed]
    return [blocks.heading(say("Not computed")), blocks.table(columns, rows)]
