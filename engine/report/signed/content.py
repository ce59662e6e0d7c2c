"""What a report to sign holds, in its order: the first page, sheets of zones, what was measured and how, signatures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...zones.profile_lines import ProfileLine
from ..figures_in_text import say
from . import blocks, parts
from .blocks import Block, Document
from .explained import explained
from .maps import slope_map
from .motion_sheets import motion_details, motion_of
from .rasters import Surface, surface_of
from .screened_sheets import screened_sheets
from .sections import given_sections, section_drawing
from .sheets import Zones, content_of, zone_sheets
from .source import Source, map_layers
from .surveyed import surveyed

_MOST_GIVEN = 8
_SECTION_MM = 58.0


def report_document(source: Source, lines: Sequence[ProfileLine] = ()) -> Document:
    """The whole report of one slope, with sections along the lines that were given.

    Raises:
        InputError: a file of the folder cannot be read.
    """
    document = Document()
    surface = surface_of(source.record, source.folder)
    layers = map_layers(source)
    named = [(line.name, line.geometry) for line in lines]
    motion = motion_of(source) if source.is_motion else None
    picture = parts.screened_slope(source, layers, parts.map_size(source)) if source.is_screening else b""
    if motion is not None:
        picture = content_of(motion.map)
    if source.is_face or (source.is_series and surface is None):
        picture = parts.whole_slope(source)
    picture = picture or slope_map(surface, replace(layers, lines=named), *parts.map_size(source))
    document.blocks.append(parts.first_page(document, source, picture))
    if not source.is_screening:
        of = Zones(source.zones, surface, layers, source.reviews, source.ends, source.record, source.events)
        document.blocks += zone_sheets(document, of)
        document.blocks += parts.more_zones(source)
        document.blocks += parts.objects_above(source)
    document.blocks += screened_sheets(document, source)
    if surface is not None:
        document.blocks += _along_lines(document, surface, lines, source.ends)
    if motion is not None:
        document.blocks += motion_details(document, motion)
    above = [] if source.is_face or (source.is_series and surface is None) else parts.pictures(document, source)
    measured = surveyed(source.record, source.details)
    document.blocks += [*above, *measured] if source.is_series else [*measured, *above]
    document.blocks += parts.screened(document, source)
    document.blocks += explained(source.record, has_screened=bool(len(source.screened)))
    document.blocks += parts.limits(source.words)
    document.blocks += parts.closing(source.details)
    return document


def _along_lines(
    document: Document, surface: Surface, lines: Sequence[ProfileLine], epochs: tuple[str, str]
) -> list[Block]:
    """Sections along the lines that were given."""
    made: list[Block] = []
    for section in given_sections(surface, lines[:_MOST_GIVEN]):
        drawn = section_drawing(section, epochs, "", _SECTION_MM)
        made.append(document.picture(drawn, section.name, height=_SECTION_MM, caption=section.name))
    return [blocks.heading(say("Sections along given lines")), *made] if made else []
