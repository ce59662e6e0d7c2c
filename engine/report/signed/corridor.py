"""The report to sign of a corridor: its slopes in the order in which they should be looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import geopandas as gpd
from shapely.geometry.base import BaseGeometry

from ...core.progress import Progress
from ...core.version import VERSION
from . import blocks, parts
from .blocks import Block, Cell, Column, Document
from .details import LABELS, Details, chainage_text, details_of
from .figures_in_text import figure, say
from .maps import MapLayers, slope_map
from .write import save, say_missing

_FIRST_PAGE_ROWS = 8
_NUMBERS = (
    "Attention",
    "Open alerts",
    "Zones",
    "Fastest (mm/day)",
    "Largest volume (m³)",
    "Largest height (m)",
    "Chainage",
    "Surveys",
)
_NUMBER_MM = 15.5
_MAP_WIDTH_MM, _MAP_MM, _ROW_MM = 176.0, 150.0, 5.3


@dataclass(frozen=True)
class SignedCorridor:
    """Slopes ``done`` with the fields of ``ranking.Ranked`` of the batch, slope and sentence of those that ``failed``,
    the tables of ``zones`` and of open ``alerts``, the ``regions`` of the slopes by name, and the manifest's name.
    """

    done: Sequence[Any]
    failed: Sequence[tuple[str, str]]
    zones: gpd.GeoDataFrame
    alerts: gpd.GeoDataFrame
    regions: Sequence[tuple[str, BaseGeometry]]
    manifest: str


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
    found = details_of({"parameters": {"details": details}}, ("",))
    record = {"software": f"SlopeWatch {VERSION}", "started": started}
    title = details.get("slope_name") or say("Corridor report")
    save(corridor_document(corridor, found, started), path, found, str(title), record)
    say_missing(found, progress)


def corridor_document(corridor: SignedCorridor, details: Details, started: str) -> Document:
    """First page with the map and the most urgent slopes, all slopes, alerts, what failed, signatures."""
    document = Document()
    shown = min(len(corridor.done), _FIRST_PAGE_ROWS)
    names = ("slope_name", "report_route", "client", "chainage_range", "author", "checker")
    rows = [(say(LABELS[name]), details[name]) for name in names]
    rows += [(say("Manifest"), corridor.manifest), (say("Made"), f"{started[:10]}, SlopeWatch {VERSION}")]
    cards = [
        (say("Slopes done"), str(len(corridor.done))),
        (say("Slopes failed"), str(len(corridor.failed))),
        (say("Zones"), str(len(corridor.zones))),
        (say("Open alerts"), str(len(corridor.alerts))),
    ]
    first: list[tuple[float, list[Block]]] = [
        (0, [parts.title(say("Corridor report"), details["slope_name"] or say("Slopes of a corridor"))]),
        (0, [blocks.facts(rows)]),
        (0, [{"kind": "verdict", "text": _verdict(corridor)}]),
        (0, [{"kind": "cards", "rows": [[*card, ""] for card in cards]}]),
    ]
    picture = slope_map(None, _layers(corridor), _MAP_WIDTH_MM, _MAP_MM - _ROW_MM * shown)
    if picture:
        first.append((1.0, [document.picture(picture, say("Map of the corridor with its slopes and zones"))]))
    first.append((0, [_slopes(corridor.done[:shown])]))
    if not picture:
        first.append((1.0, [blocks.lines()]))
    document.blocks.append(blocks.sheet(first, gap=3.0))
    document.blocks += [blocks.heading(say("All slopes, what asks for most attention first")), _slopes(corridor.done)]
    document.blocks += _alerts(corridor.alerts) + _failed(corridor.failed)
    document.blocks += [
        blocks.heading(say("What this cannot tell you")),
        blocks.paragraph(
            say(
                "A slope at the end of the table showed no change above the level of detection; that is no statement "
                "about its stability. Each slope has a report of its own with its thresholds and limits."
            )
        ),
    ]
    document.blocks += parts.closing(details)
    return document


def _verdict(corridor: SignedCorridor) -> str:
    urgent = sum(1 for slope in corridor.done if slope.attention >= 2)
    return say(
        f"Slopes looked at: {len(corridor.done)}; with an attention of 2 or more: {urgent}; "
        f"open alerts: {len(corridor.alerts)}."
    )


def _layers(corridor: SignedCorridor) -> MapLayers:
    """Regions of the slopes as footprints, with their names as those of zones, and the zones within."""
    crs = corridor.zones.crs
    regions = gpd.GeoDataFrame(
        {"zone_id": [name for name, _ in corridor.regions]}, geometry=[s for _, s in corridor.regions], crs=crs
    )
    zones = corridor.zones if not len(regions) else regions
    within = corridor.zones if len(regions) and len(corridor.zones) else None
    return MapLayers(zones, None, within, names=("region of a slope" if len(regions) else "zone of change", "zone"))


def _slopes(done: Sequence[Any]) -> Block:
    columns = [
        Column(say("Slope"), left=True, wide=True),
        *(Column(say(words), width=_NUMBER_MM) for words in _NUMBERS),
        Column(say("Last survey")),
    ]
    rows: list[list[Cell]] = []
    for slope in done:
        values = {name: getattr(slope, name) for name in ("rate_mm_day", "volume_m3", "largest_m")}
        rows.append(
            [
                slope.slope,
                str(slope.attention),
                str(slope.open_alerts),
                str(slope.zones),
                figure(values, "rate_mm_day", digits=2, sign=True),
                figure(values, "volume_m3", digits=2, sign=True),
                figure(values, "largest_m", digits=2, sign=True),
                "–" if slope.chainage is None else chainage_text(slope.chainage),
                str(slope.surveys),
                slope.last_day,
            ]
        )
    return blocks.table(columns, rows, size=7.2)


def _alerts(alerts: gpd.GeoDataFrame) -> list[Block]:
    if not len(alerts):
        return []
    columns = [Column(say("Slope"), left=True), Column(say("Zone"), left=True), Column(say("Attention"))]
    columns += [Column(say("Reason"), left=True, wide=True), Column(say("Raised on"), left=True)]
    columns += [Column(say("State"), left=True), Column(say("By"), left=True)]
    rows: list[list[Cell]] = [
        [
            str(a["slope"]), str(a["zone_id"]), figure(a, "attention", digits=0), say(str(a["reason"])),
            str(a["raised_on"]), say(str(a["state"])), str(a["reviewer"]),
        ]
        for a in alerts.to_dict("records")
    ]  # fmt: skip
    return [blocks.heading(say("Open alerts")), blocks.table(columns, rows)]


def _failed(failed: Sequence[tuple[str, str]]) -> list[Block]:
    if not failed:
        return []
    columns = [Column(say("Slope"), left=True), Column(say("Why"), left=True, wide=True)]
    rows: list[list[Cell]] = [[slope, say(sentence)] for slope, sentence in failed]
    return [blocks.heading(say("Not computed")), blocks.table(columns, rows)]
