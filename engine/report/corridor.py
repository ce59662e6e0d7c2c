"""The page of a corridor: its slopes in the order in which they should be looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import geopandas as gpd
import shapely
from markupsafe import Markup
from shapely.geometry.base import BaseGeometry

from ...interface.language import current_language
from ...interface.rates import RULE, RateUnit, rate_unit
from ..core.templates import render
from .embedding import Picture, encoded
from .signed.corridor_pictures import Span, corridor_map, road_strip, strip_height
from .signed.details import chainage_text

_TEMPLATES = Path(__file__).resolve().parent / "templates"


def corridor_page(
    done: Sequence[Any],
    failed: Sequence[tuple[str, str]],
    alerts: Sequence[Mapping[str, Any]],
    facts: Mapping[str, Any],
    pictures: Mapping[str, Picture] = MappingProxyType({}),
) -> str:
    """The page as HTML; every text that comes from a file is escaped.

    Args:
        done: slopes with the fields of ``ranking.Ranked`` of the batch; ``report`` is a path from the page.
        failed: slope and sentence.
        alerts: open events.
        facts: ``software``, ``manifest``, ``count`` (of all slopes) and ``zones``; ``levels`` and ``withdrawn`` as
            ``corridor_alerts`` gives them.
        pictures: see ``corridor_pictures``.
    """
    css = Markup((_TEMPLATES / "report.css").read_text(encoding="utf-8"))
    unit = rate_unit(slope.rate_mm_day for slope in done)
    shown = [{name: _shown(name, getattr(slope, name), unit) for name in slope.__dataclass_fields__} for slope in done]
    return render(
        _TEMPLATES / "corridor.html.j2",
        current_language(),
        css=css,
        rates=unit,
        rate_rule=RULE,
        done=shown,
        failed=failed,
        alerts=alerts,
        open_alerts=len(alerts),
        pictures=pictures,
        **({"levels": {}, "withdrawn": []} | dict(facts)),
    )


def corridor_pictures(
    zones: gpd.GeoDataFrame,
    regions: Sequence[tuple[str, BaseGeometry]],
    attentions: Mapping[str, int],
    spans: Sequence[Span],
) -> dict[str, Picture]:
    """``map`` with the slopes where they lie, ``road`` where they have chainages; what cannot be drawn is left out.

    Args:
        zones: of all slopes, with their ``slope``.
        regions: of the slopes, by their names.
        attentions: of the slopes that are done, by their names.
        spans: places of slopes on their roads.
    """
    found = {}
    names = ", ".join(name for name, _ in regions[:_NAMED])
    more = f", {len(regions) - _NAMED} more" if len(regions) > _NAMED else ""
    size = _WIDTH_MM, _height(zones, regions)
    drawn = corridor_map(zones, regions, dict(attentions), spans, size)
    if drawn:
        found["map"] = encoded(drawn, f"Map of the slopes in the colours of their attention: {names}{more}", size)
    if spans:
        size = _WIDTH_MM, strip_height(spans)
        places = ", ".join(f"{span.slope} at {chainage_text(span.begin)}" for span in spans[:_NAMED])
        found["road"] = encoded(road_strip(spans, size[0]), f"The roads drawn straight, with {places}", size)
    return found


def _height(zones: gpd.GeoDataFrame, regions: Sequence[tuple[str, BaseGeometry]]) -> float:
    """Millimetres of a map in which the slopes leave little white above and below them."""
    shapes = [shape for _, shape in regions] or list(zones.geometry)
    if not shapes:
        return _HEIGHTS_MM[0]
    west, south, east, north = shapely.total_bounds(shapes)
    return min(max(_FOOT_MM + _WIDTH_MM * (north - south) / max(east - west, 1e-3), _HEIGHTS_MM[0]), _HEIGHTS_MM[1])


_WIDTH_MM, _HEIGHTS_MM, _FOOT_MM = 250.0, (75.0, 160.0), 45.0
_NAMED = 12
"""Slopes that are named to those who cannot see the pictures; the table has all."""
_DECIMALS = {"rate_mm_day": 1, "volume_m3": 2, "largest_m": 2, "chainage": 0}


def _shown(name: str, value: Any, unit: RateUnit) -> Any:
    """A figure as people read it."""
    if name not in _DECIMALS:
        return value
    scale = unit.days if name == "rate_mm_day" else 1.0
    return "–" if value is None else f"{value * scale + 0.0:,.{_DECIMALS[name]}f}"
