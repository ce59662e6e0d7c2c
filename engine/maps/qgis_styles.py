"""QGIS styles (QML) for the rasters and zones of a run, written without QGIS.

They keep to the elements that QGIS 3.34 to 4 reads; what is left out takes QGIS's defaults.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from ..core.staged_outputs import atomic_output
from .palette import BELOW_LEVEL, DIVERGING, LIKELIHOOD, SEQUENTIAL, Colour, hexadecimal, sequential_steps
from .qgis_style_parts import VERSION, attribute_table, categorized, document, forms, labels, options

# What analysts read in the attribute table instead of the field's name.
ALIASES = {
    "zone_id": "Zone",
    "slope_id": "Slope",
    "route": "Route",
    "chain_from": "Chainage from (m)",
    "chain_to": "Chainage to (m)",
    "side": "Side",
    "epoch_from": "From epoch",
    "epoch_to": "To epoch",
    "days": "Days between",
    "kind": "Kind",
    "severity": "Severity",
    "confidence": "Confidence",
    "dz_mean_m": "Mean change (m)",
    "dz_min_m": "Lowest change (m)",
    "dz_max_m": "Highest change (m)",
    "dz_p95_m": "Change, 95th percentile (m)",
    "area_m2": "Area (m²)",
    "n_cells": "Cells",
    "vol_loss_m3": "Volume lost (m³)",
    "vol_gain_m3": "Volume gained (m³)",
    "vol_net_m3": "Net volume (m³)",
    "vol_err_m3": "Standard error of volume (m³)",
    "vol_low_m3": "Net volume, 95 % from (m³)",
    "vol_high_m3": "Net volume, 95 % to (m³)",
    "vol_area_m2": "Area of the volume (m²)",
    "vol_measured": "Part of it that was measured",
    "n_eff": "Effective samples of the volume",
    "lod95_m": "Level of detection, median (m)",
    "rate_mm_day": "Rate (mm/day)",
    "rate_err": "Standard error of rate (mm/day)",
    "slope_deg": "Inclination (degrees)",
    "n_pts_min": "Fewest points in a cell",
    "n_epochs_confirmed": "Epochs that confirm",
    "review_status": "Review",
    "reviewer": "Reviewer",
    "remarks": "Remarks",
    "method": "Method",
    "run_id": "Run",
}
HAZARD_ALIASES = {
    **{name: ALIASES[name] for name in ("zone_id", "slope_id", "route", "chain_from", "chain_to", "side")},
    "class": "Class",
    "kind": "Kind",
    "confidence": "Confidence",
    "probability": "Mean probability",
    "height_med_m": "Height over the trend, median (m)",
    "height_p95_m": "Height over the trend, 95th percentile (m)",
    "area_m2": "Area of the slope (m²)",
    "plan_m2": "Area on the map (m²)",
    "slope_deg": "Inclination (degrees)",
    "points": "Points",
    "n_cells": "Cells",
    **{name: ALIASES[name] for name in ("review_status", "reviewer", "remarks", "method", "run_id")},
}
_HAZARDS_READ_FIRST = (
    "zone_id",
    "kind",
    "confidence",
    "probability",
    "area_m2",
    "height_med_m",
    "height_p95_m",
    "points",
)
FOOTPRINT_ALIASES = {
    name: ALIASES[name]
    for name in (
        "zone_id", "kind", "vol_net_m3", "vol_err_m3", "vol_low_m3", "vol_high_m3", "vol_area_m2", "vol_measured",
    )
}  # fmt: skip
CONFIRMATION_ALIASES = {
    "confirmed": "Confirmed by the change",
    "compared_share": "Part compared",
    "change_share": "Part of it with change of its sign",
    "opposite_share": "Part of it with change of the other sign",
    "dz_signif_m": "Mean significant change (m)",
}
_LOOKS = ((4, 150, 0.4), (3, 110, 0.3), (2, 80, 0.2), (1, 40, 0.1))
"""Place of the colour in ``DIVERGING``, opacity, width of the line (mm) of the grades from the highest on."""
_READ_FIRST = ("zone_id", "kind", "severity", "area_m2", "dz_mean_m", "dz_p95_m", "vol_net_m3", "vol_err_m3", "lod95_m")
_OUTLINE = "boundary(buffer(buffer($geometry, {}, 4), {}, 4))"
# Metres out and back. Zones of a change are scattered cells, which the outline gathers. Zones of the screening are
# whole and lie side by side, where a wide outline would run through the neighbour.
_GATHERING, _FOLLOWING = (0.5, -0.4), (0.15, -0.1)
# Decimals in the table and the form: the measured figures by the end of their names.
_DECIMALS = {"_m": 3, "_m2": 2, "_m3": 3, "_deg": 1, "_mm_day": 2, "_err": 2, "_share": 2, "probability": 2}
_DECIMALS |= {"vol_measured": 2, "n_eff": 1}

_MAP_TIP = """<b>[% "zone_id" %]: [% "kind" %], [% "severity" %]</b><br/>
mean [% format_number("dz_mean_m", 3) %] m, 95 % within [% format_number("dz_p95_m", 3) %] m<br/>
area [% format_number("area_m2", 1) %] m²,
volume [% format_number("vol_net_m3", 2) %] ± [% format_number("vol_err_m3", 2) %] m³<br/>
[% "epoch_from" %] to [% "epoch_to" %]"""


_VOLUME_LABEL = (
    """"zone_id" || ': ' || if("vol_net_m3" > 0, '+', '') || format_number("vol_net_m3", 2)"""
    """ || ' ± ' || format_number("vol_err_m3", 2) || ' m³'"""
)
_FOOTPRINT_MAP_TIP = """<b>[% "zone_id" %]: [% "kind" %], volume and where it was taken</b><br/>
[% format_number("vol_net_m3", 2) %] ± [% format_number("vol_err_m3", 2) %] m³,
95 % within [% format_number("vol_low_m3", 2) %] to [% format_number("vol_high_m3", 2) %]<br/>
over [% format_number("vol_area_m2", 1) %] m², measured on [% format_number(100 * "vol_measured", 0) %] % of it"""
_HAZARD_MAP_TIP = """<b>[% "zone_id" %]: [% "kind" %], confidence [% "confidence" %]</b><br/>
mean probability [% format_number("probability", 2) %]<br/>
[% format_number("height_med_m", 3) %] m over the trend, 95 % within [% format_number("height_p95_m", 3) %] m<br/>
area [% format_number("area_m2", 1) %] m²"""

_CONFIRMATION_MAP_TIP = """<br/>
[% "confirmed" %] by the change"""


def change_qml(limit: float, level: float | None = None) -> str:
    """Diverging, zero-centred style of an elevation-change raster: lowering red, raising blue.

    Args:
        limit: the ramp runs from -limit to +limit, metres.
        level: change below this, metres, is drawn in a faint grey (the median level of detection).
    """
    stops: list[tuple[float, Colour, int, str]] = []
    inner = level if level is not None and 0 < level < limit else 0.0
    for share, low, high in DIVERGING:
        value = share * limit
        # a stop close to the grey band's edge would only crowd the legend
        if value - inner > 0.05 * limit or (value == 0 and not inner):
            stops.append((value, high, 255, _signed(value)))
            if value:
                stops.append((-value, low, 255, _signed(-value)))
    if inner:
        # two stops close together make the hard edge of the grey band
        edge = inner * 1.0001
        stops += [
            (-inner, BELOW_LEVEL, 70, "below the level of detection"),
            (inner, BELOW_LEVEL, 70, f"(median {inner:.3f} m)"),
            (edge, _between(inner / limit, raising=True), 255, _signed(inner)),
            (-edge, _between(inner / limit, raising=False), 255, _signed(-inner)),
        ]
    return _raster_qml(sorted(stops, key=lambda s: s[0]))


def level_qml(limit: float) -> str:
    """Sequential style of a level-of-detection raster, from 0 to ``limit`` metres."""
    return _raster_qml([(s * limit, colour, 255, f"{s * limit:.3f} m") for s, colour in SEQUENTIAL])


def cell_size_qml(sizes: Sequence[float]) -> str:
    """Style of a raster of cell sizes: a colour for each of the ``sizes`` (metres, ascending), lightest the finest."""
    colours = sequential_steps(len(sizes))
    stops = [(size, colour, 255, f"{size:g} m") for size, colour in zip(sizes, colours, strict=True)]
    return _raster_qml(stops, suffix="")


def zones_qml() -> str:
    """Style of the zones by kind and severity, labelled with their ids, with aliases, map tip and a review list."""
    return _zones_qml("severity", ("high", "moderate", "low", "unsure"), ALIASES, _READ_FIRST, _MAP_TIP, _GATHERING)


def hazards_qml(*, confirmed: bool = False) -> str:
    """Style of the screening's zones by kind and confidence, otherwise as ``zones_qml``.

    Args:
        confirmed: whether they have the columns of ``confirmation.FIELDS``.
    """
    first: tuple[str, ...] = _HAZARDS_READ_FIRST
    aliases, tip = HAZARD_ALIASES, _HAZARD_MAP_TIP
    if confirmed:
        aliases = {**aliases, **CONFIRMATION_ALIASES}
        first = (*first[:3], "confirmed", *first[3:], *(name for name in CONFIRMATION_ALIASES if name != "confirmed"))
        tip += _CONFIRMATION_MAP_TIP
    return _zones_qml("confidence", ("high", "medium", "low"), aliases, first, tip, _FOLLOWING)


def footprints_qml() -> str:
    """Style of the footprints of the volumes: a dashed outline and a faint fill by kind, labelled with zone and volume.

    The zones, which are drawn in full, lie within; both layers can be shown at once.
    """
    root, categories, symbols = categorized("kind")
    veils, edges = DIVERGING[3][1:], DIVERGING[-2][1:]
    for number, kind in enumerate(("subsidence", "uplift")):
        label = f"Footprint of the volume, {kind}"
        SubElement(categories, "category", value=kind, label=label, symbol=str(number), render="true", type="string")
        symbol = SubElement(symbols, "symbol", type="fill", name=str(number), alpha="1", clip_to_extent="1")
        fill = SubElement(symbol, "layer", {"class": "SimpleFill", "enabled": "1", "locked": "0", "pass": "0"})
        options(fill, color=_rgba(veils[number], 45), outline_style="no", style="solid")
        _outline(symbol, edges[number], 0.4, dashed=True)
    labels(root, _VOLUME_LABEL)
    attribute_table(root, FOOTPRINT_ALIASES, tuple(FOOTPRINT_ALIASES))
    forms(root, FOOTPRINT_ALIASES, _DECIMALS)
    SubElement(root, "mapTip", enabled="1").text = _FOOTPRINT_MAP_TIP
    SubElement(root, "layerGeometryType").text = "2"
    return document(root)


def probability_qml() -> str:
    """Style of a probability raster's first band: greys, a thin veil where nothing is likely.

    Greys, because colour is the zones' that lie over it: a bluish probability looks like uplift. The veil distinguishes
    what was screened from what was not, as on the map picture.
    """
    stops = [(s, colour, 255 if s else 120, f"{100 * s:.0f} %") for s, colour in LIKELIHOOD]
    return _raster_qml(stops, suffix="")


def _zones_qml(
    grade: str,
    grade_names: tuple[str, ...],
    aliases: dict[str, str],
    first: tuple[str, ...],
    tip: str,
    outline: tuple[float, float],
) -> str:
    root, categories, symbols = categorized(f'concat("kind", \', \', "{grade}")')
    looks = zip(grade_names, _LOOKS[: len(grade_names)], strict=True)
    pairs = [(kind, name, *look) for name, look in looks for kind in ("subsidence", "uplift")]
    pairs.sort(key=lambda pair: pair[0])
    for number, (kind, name, stop, opacity, width) in enumerate(pairs):
        low, high = DIVERGING[stop][1:], DIVERGING[-1][1:]
        arm = 0 if kind == "subsidence" else 1
        SubElement(
            categories,
            "category",
            value=f"{kind}, {name}",
            label=f"{kind.capitalize()}, {name}",
            symbol=str(number),
            render="true",
            type="string",
        )
        symbol = SubElement(symbols, "symbol", type="fill", name=str(number), alpha="1", clip_to_extent="1")
        fill = SubElement(symbol, "layer", {"class": "SimpleFill", "enabled": "1", "locked": "0", "pass": "0"})
        options(fill, color=_rgba(low[arm], opacity), outline_style="no", style="solid")
        # around cells that lie close: a zone has many parts and holes of one cell, whose outlines would cover it
        generator = SubElement(
            symbol, "layer", {"class": "GeometryGenerator", "enabled": "1", "locked": "0", "pass": "0"}
        )
        options(generator, SymbolType="Line", geometryModifier=_OUTLINE.format(*outline), units="MapUnit")
        ring = SubElement(generator, "symbol", type="line", name=f"@{number}@1", alpha="1", clip_to_extent="1")
        _outline(ring, high[arm], width)
    labels(root)
    attribute_table(root, aliases, first)
    forms(root, aliases, _DECIMALS)
    SubElement(root, "mapTip", enabled="1").text = tip
    SubElement(root, "layerGeometryType").text = "2"
    return document(root)


def _outline(symbol: Element, colour: Colour, width: float, *, dashed: bool = False) -> None:
    """A line (millimetres) over a light seam, which keeps it legible on a dark picture."""
    for shade, alpha, extra, style in (
        ((255, 255, 255), 200, 0.5, "solid"),
        (colour, 255, 0.0, "dash" if dashed else "solid"),
    ):
        line = SubElement(symbol, "layer", {"class": "SimpleLine", "enabled": "1", "locked": "0", "pass": "0"})
        options(
            line,
            line_color=_rgba(shade, alpha),
            line_style=style,
            line_width=f"{width + extra:g}",
            line_width_unit="MM",
            joinstyle="round",
        )


def write_qml_beside(raster: Path, qml: str) -> Path:
    """Write ``qml`` where QGIS finds it when it loads ``raster``: same folder, same stem. Returns that path."""
    path = Path(raster).with_suffix(".qml")
    with atomic_output(path) as partial:
        partial.write_text(qml, encoding="utf-8")
    return path


def _raster_qml(stops: list[tuple[float, Colour, int, str]], *, suffix: str = " m") -> str:
    root = Element("qgis", version=VERSION, styleCategories="Symbology")
    pipe = SubElement(root, "pipe")
    low, high = _number(stops[0][0]), _number(stops[-1][0])
    renderer = SubElement(
        pipe,
        "rasterrenderer",
        type="singlebandpseudocolor",
        band="1",
        opacity="1",
        alphaBand="-1",
        classificationMin=low,
        classificationMax=high,
    )
    origin = SubElement(renderer, "minMaxOrigin")
    SubElement(origin, "limits").text = "None"
    shader = SubElement(
        SubElement(renderer, "rastershader"),
        "colorrampshader",
        colorRampType="INTERPOLATED",
        classificationMode="1",
        clip="0",
        minimumValue=low,
        maximumValue=high,
    )
    for value, colour, alpha, label in stops:
        SubElement(shader, "item", value=_number(value), color=hexadecimal(colour), alpha=str(alpha), label=label)
    # each stop in the legend: the continuous bar would name the two ends only
    SubElement(shader, "rampLegendSettings", useContinuousLegend="0", suffix=suffix)
    SubElement(root, "blendMode").text = "0"
    return document(root)


def _between(share: float, *, raising: bool) -> Colour:
    """Colour of the ramp at ``share`` (0 to 1) of its range, between its stops."""
    stops = [(position, high if raising else low) for position, low, high in DIVERGING]
    for (first, start), (second, end) in pairwise(stops):
        if share <= second:
            t = (share - first) / (second - first)
            red, green, blue = (round(a + t * (b - a)) for a, b in zip(start, end, strict=True))
            return red, green, blue
    return stops[-1][1]


def _signed(value: float) -> str:
    if value == 0:
        return "0 m"
    return f"{value:+.3f} m {'raised' if value > 0 else 'lowered'}"


def _number(value: float) -> str:
    return f"{value:.9g}"


def _rgba(colour: Colour, alpha: int) -> str:
    return ",".join(str(c) for c in (*colour, alpha))
