"""QGIS styles of a series: when a layer is shown by the temporal controller, zones by alert level, states in time."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, timedelta
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from ..series.alerts import AlertLevel
from ..series.tables import SERIES_FIELDS
from .palette import DIVERGING, SEQUENTIAL, hexadecimal
from .qgis_style_parts import HEAD, VERSION, attribute_table, categorized, document, forms, labels, options, read_only
from .qgis_styles import ALIASES

_FIXED_RANGE = "0"  # of a raster's temporal modes
_FROM_FIELDS = "2"  # of a vector's: start and end from two fields

SERIES_ALIASES: dict[str, str] = {
    **ALIASES,
    "alert_level": "Alert level",
    "alert": "Alert",
    "alert_reason": "Why this alert level",
    "action": "What to do",
    "status": "Status",
    "rate_low": "Rate, lower end of 95 % (mm/day)",
    "rate_high": "Rate, upper end of 95 % (mm/day)",
    "rate_last": "Rate between the last two surveys (mm/day)",
    "rate_last_err": "Standard error of that (mm/day)",
    "velocity_class": "Class of Cruden and Varnes",
    "trend": "Trend",
    "onset_from": "At rest until",
    "onset_to": "In motion by",
    "tangent_angle": "Tangent angle (degrees)",
    "tangent_level": "Level of the tangent angle",
    "tangent_note": "Tangent angle, why not",
    "failure_from": "Failure not before (95 %)",
    "failure_to": "Failure not after (95 %)",
    "failure_note": "Failure time, why not",
    "first_seen": "First seen",
    "last_seen": "Last seen",
    "merged": "Zones merged into it",
    "split_from": "Split from",
    "n_epochs": "Surveys that measured it",
}
_FIRST = (
    "zone_id",
    "alert",
    "kind",
    "status",
    "rate_mm_day",
    "rate_low",
    "rate_high",
    "trend",
    "n_epochs_confirmed",
    "dz_mean_m",
    "area_m2",
    "vol_net_m3",
    "vol_err_m3",
    "alert_reason",
    "action",
)
_TIP = """<b>[% "zone_id" %]: [% "alert" %]</b> ([% "kind" %], [% "status" %])<br/>
[% format_number("rate_mm_day", 2) %] mm/day, 95 % within [% format_number("rate_low", 2) %] to
[% format_number("rate_high", 2) %]; [% "trend" %]<br/>
mean [% format_number("dz_mean_m", 3) %] m, volume [% format_number("vol_net_m3", 2) %] ±
[% format_number("vol_err_m3", 2) %] m³ since [% "epoch_from" %]<br/>
[% "alert_reason" %]"""
STATES = ("lowered", "raised", "below its level", "not measured")
_DECIMALS = {"_m": 3, "_m2": 2, "_m3": 3, "_deg": 1, "rate_": 2, "tangent_angle": 1}


def shown_during(qml: str, begin: date, end: date) -> str:
    """A raster's style with the days on which the temporal controller shows it: after ``begin`` until ``end``."""
    root = ElementTree.fromstring(qml.removeprefix(HEAD))
    root.set("styleCategories", f"{root.get('styleCategories', 'Symbology')}|Temporal")
    temporal = SubElement(root, "temporal", enabled="1", mode=_FIXED_RANGE, fetchMode="0")
    fixed = SubElement(temporal, "fixedRange")
    SubElement(fixed, "start").text = f"{(begin + timedelta(days=1)).isoformat()}T00:00:00Z"
    SubElement(fixed, "end").text = f"{end.isoformat()}T23:59:59Z"
    return document(root)


def confirmed_qml(largest: int) -> str:
    """Style of the raster of comparisons that confirm a cell: none is transparent."""
    root = Element("qgis", version=VERSION, styleCategories="Symbology")
    renderer = SubElement(
        SubElement(root, "pipe"), "rasterrenderer", type="paletted", band="1", opacity="1", alphaBand="-1"
    )
    entries = SubElement(renderer, "colorPalette")
    for count in range(max(largest, 1) + 1):
        place = min(len(SEQUENTIAL) - 1, round(count / max(largest, 1) * (len(SEQUENTIAL) - 1)))
        label = {0: "none", 1: "1 comparison, not confirmed"}.get(count, f"{count} comparisons in a row")
        colour = hexadecimal(SEQUENTIAL[place][1])
        SubElement(entries, "paletteEntry", value=str(count), color=colour, alpha="255" if count else "0", label=label)
    return document(root)


def zones_qml(alerts: Sequence[AlertLevel]) -> str:
    """Style of the tracked zones by alert level, in the table's colours."""
    root = _layer_root("alert_level", [(str(a.level), f"{a.level} {a.name}", a.colour, 40) for a in alerts])
    labels(root)
    attribute_table(root, SERIES_ALIASES, _FIRST)
    forms(root, SERIES_ALIASES, _DECIMALS)
    SubElement(root, "mapTip", enabled="1").text = _TIP
    SubElement(root, "layerGeometryType").text = "2"
    return document(root)


def states_qml() -> str:
    """Style of the zones survey by survey: what their mean change is, shown on the days up to the survey."""
    _, lowered, raised = DIVERGING[3]
    colours = (hexadecimal(lowered), hexadecimal(raised), "#9e9e9e", "#ffffff")
    root = _layer_root(
        "state",
        [(s, s.capitalize(), c, a) for s, c, a in zip(STATES, colours, (170, 170, 60, 0), strict=True)],
    )
    labels(root)
    SubElement(
        root,
        "temporal",
        enabled="1",
        mode=_FROM_FIELDS,
        startField="time_from",
        endField="time_to",
        limitMode="0",
        startExpression="",
        endExpression="",
        durationField="",
        durationUnit="min",
        fixedDuration="0",
        accumulate="0",
    )
    read_only(root, SERIES_FIELDS)
    SubElement(root, "layerGeometryType").text = "2"
    return document(root)


def _layer_root(field: str, categories: list[tuple[str, str, str, int]]) -> Element:
    """A layer with a fill and an outline for each category: value, label, colour (#rrggbb) and opacity of the fill."""
    root, listed, symbols = categorized(field, "|Temporal")
    for number, (value, label, colour, opacity) in enumerate(categories):
        SubElement(listed, "category", value=value, label=label, symbol=str(number), render="true", type="string")
        symbol = SubElement(symbols, "symbol", type="fill", name=str(number), alpha="1", clip_to_extent="1")
        fill = SubElement(symbol, "layer", {"class": "SimpleFill", "enabled": "1", "locked": "0", "pass": "0"})
        red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
        options(
            fill,
            color=f"{red},{green},{blue},{opacity}",
            outline_color=f"{red * 3 // 4},{green * 3 // 4},{blue * 3 // 4},255",
            outline_style="solid",
            outline_width="0.8",
            outline_width_unit="MM",
            style="solid",
        )
    return root
