"""The report to sign of motion along the surface alone: its map, the zones that slide, sections, thresholds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..figures_in_text import figure, percent, say, value_of, with_error
from ..motion import MotionFiles, MotionSection, motion_section
from . import blocks
from .blocks import Block, Cell, Column, Document
from .sheets import content_of
from .source import Source

_FIRST_PAGE_ROWS, _MOST_ROWS = 6, 60
_SECTION_MM = 62.0
_NO_CHANCE = 0.0001


def motion_of(source: Source) -> MotionSection | None:
    """What the HTML report draws of the motion; None where nothing was measured.

    Raises:
        InputError: a file of the folder is missing or damaged.
    """
    return motion_section(source.record.get("displacement"), MotionFiles.of(source.folder), source.ends)


def first_zones(facts: Mapping[str, Any]) -> list[Block]:
    """The zones that the first page names."""
    zones = facts.get("zones") or []
    if not zones:
        return []
    made = [_zones(zones[:_FIRST_PAGE_ROWS])]
    if len(zones) > _FIRST_PAGE_ROWS:
        made.append(blocks.paragraph(say(f"All {len(zones)} zones are in the table below."), small=True))
    return made


def motion_details(document: Document, section: MotionSection) -> list[Block]:
    """Zones that the first page has no room for, sections through the largest, and where nothing is known."""
    facts = section.facts
    zones, made = facts.get("zones") or [], []
    if len(zones) > _FIRST_PAGE_ROWS:
        made += [blocks.heading(say("All zones")), _zones(zones[:_MOST_ROWS])]
    if section.sections:
        made.append(blocks.heading(say("Sections through the zones")))
    for name, drawn in section.sections:
        words = say(f"{name}, from the top down: both surfaces, and the vectors near the line in the section’s plane.")
        made.append(document.picture(content_of(drawn), words, height=_SECTION_MM, caption=words))
    return made + _unknown(facts) + _explained(facts)


def _zones(zones: Sequence[Mapping[str, Any]]) -> Block:
    columns = [
        Column(say("Zone"), left=True),
        Column(say("Motion (m)")),
        Column(say("Direction"), left=True, wide=True),
        Column(say("Azimuth, plunge (°)")),
        Column(say("Down the dip (m)")),
        Column(say("To the left (m)")),
        Column(say("Off the surface (m)")),
        Column(say("Area (m²)")),
        Column(say("By chance")),
        Column(say("Place (x, y)")),
    ]
    rows: list[list[Cell]] = [
        [
            str(zone["zone_id"]),
            with_error(zone, "length_m", "length_err_m", digits=3, sign=False),
            say(str(zone["direction"])),
            f"{figure(zone, 'azimuth_deg', digits=0)}, {figure(zone, 'plunge_deg', digits=0)}",
            with_error(zone, "along_dip_m", "along_dip_err_m", digits=3),
            with_error(zone, "across_m", "across_err_m", digits=3),
            with_error(zone, "normal_m", "normal_err_m", digits=3),
            figure(zone, "area_m2", digits=1),
            _by_chance(zone),
            f"{zone['x']:.1f}, {zone['y']:.1f}",
        ]
        for zone in zones
    ]
    return blocks.table(columns, rows, size=6.2)


def _by_chance(zone: Mapping[str, Any]) -> str:
    value = value_of(zone, "p_map")
    return f"< {_NO_CHANCE}" if value is not None and value < _NO_CHANCE else figure(zone, "p_map", digits=4)


def _unknown(facts: Mapping[str, Any]) -> list[Block]:
    refused = facts.get("refused") or []
    if not refused:
        return []
    columns = [Column(say("Reason"), left=True, wide=True), Column(say("Share of the windows"))]
    rows: list[list[Cell]] = [[say(str(row["reason"])), percent(row, "share", 1)] for row in refused]
    return [blocks.heading(say("Where nothing is known of the motion")), blocks.table(columns, rows)]


def _explained(facts: Mapping[str, Any]) -> list[Block]:
    window, sure = figure(facts, "window_m", "m", 1), percent(facts, "confidence")
    rows = [
        (
            say("Vector"),
            say(
                f"The motion of the relief in a window of {window} from one survey to the other. It is significant "
                f"where still ground would show so much with a probability below {_chance(facts)}."
            ),
        ),
        (
            say("Zone"),
            say(
                "Adjoining windows that move as one; its vector is one fit over all of it, and by chance is the "
                "probability that still ground shows such a zone anywhere on the map."
            ),
        ),
        (
            say("Smallest motion that shows"),
            say(
                f"At {sure} confidence a motion below {figure(facts, 'smallest_median_m', 'm')} (median of the "
                "windows) cannot be distinguished from none; smallest_motion.tif has it for each place."
            ),
        ),
        (say("Errors"), _errors(facts)),
    ]
    return [blocks.heading(say("Thresholds explained")), blocks.terms(rows)]


def _chance(facts: Mapping[str, Any]) -> str:
    return percent({"chance": 1.0 - float(facts["confidence"])}, "chance")


def _errors(facts: Mapping[str, Any]) -> str:
    if facts.get("registration_known"):
        return say("One standard error, of the relief and of the registration along the surface.")
    return say("One standard error, of the relief alone: that of the registration is not known.")
