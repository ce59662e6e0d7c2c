"""QGIS styles (QML) for the rasters and zones of a run, made of the templates in ``styles/`` without QGIS."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ...interface.seen import LABELS, NOT_SEEN
from ..core.staged_outputs import atomic_output
from ..core.templates import render
from ..objects.kinds import BOULDER, HEAP, UNKNOWN, VEGETATION, WALL
from ..objects.table import APPEARED, VANISHED
from ..objects.table import FIELDS as OBJECT_FIELDS
from ..series.alerts import AlertLevel
from ..series.tables import SERIES_FIELDS, ZONE_FIELDS
from ..vector.review_fields import LOCATION_FIELDS, PLACE_FIELDS, REVIEW_FIELDS, STATES
from ..zones.fields import FIELDS, KINDS, NOT_SEEN_FIELDS, REASONS, SEVERITIES, SLIDING, UNSURE_FIELDS
from .palette import (
    BELOW_LEVEL,
    DIVERGING,
    LIKELIHOOD,
    SEEN,
    SEQUENTIAL,
    SLIDING_LINE,
    SLIDING_TINTS,
    UNSEEN_FILL,
    UNSEEN_STRIPE,
    Colour,
    hexadecimal,
    sequential_steps,
    signed_colours,
)

_TEMPLATES = Path(__file__).resolve().parent / "styles"
FOOTPRINT_FIELDS = (
    "zone_id", "kind", "vol_net_m3", "vol_err_m3", "vol_low_m3", "vol_high_m3", "vol_area_m2", "vol_measured",
)  # fmt: skip
_LOOKS = tuple(
    (DIVERGING[place][1:], alpha, width)
    for place, alpha, width in ((4, 150, 0.4), (3, 110, 0.3), (2, 80, 0.2), (1, 40, 0.1))
)
"""Of the grades from the highest on: colours of lowering and raising, opacity, width of the line (mm)."""
_ATTENTION: tuple[Colour, ...] = (
    (130, 130, 130), (242, 206, 75), (240, 150, 50), (214, 48, 42), (141, 20, 16),
)  # fmt: skip
"""Colours of a corridor's zones by their attention, 0 to 4 and more."""
_GROUND: Colour = (190, 186, 178)
"""Of points that are no hazard."""
_OBJECT_LOOKS: tuple[tuple[str, Colour, int, Colour, float], ...] = (
    (BOULDER, (230, 120, 20), 120, (150, 70, 0), 0.6),
    (WALL, (120, 120, 120), 120, (60, 60, 60), 0.6),
    (HEAP, (200, 170, 40), 120, (120, 95, 0), 0.6),
    (UNKNOWN, (190, 186, 178), 60, (110, 110, 110), 0.3),
    (VEGETATION, (120, 180, 110), 40, (90, 140, 80), 0.2),
)
"""Of objects by kind: fill, opacity, colour and width (mm) of the line."""
_REASONS = {
    "chance": "No zone: noise alone may make it",
    "vegetation": "No zone: within the error by vegetation",
    "season": "No zone: the vegetation differs as much",
    "small": "No zone: smaller than the minimum size",
}
_STATES = ("lowered", "raised", "below its level", "not measured")


def change_qml(
    limit: float,
    level: float | None = None,
    *,
    unit: str = "m",
    shown: tuple[date, date] | None = None,
    opacity_band: int | None = None,
    only_beyond: bool = False,
) -> str:
    """Diverging, zero-centred style of an elevation-change raster: lowering red, raising blue.

    Args:
        limit: the ramp runs from -limit to +limit, in ``unit``.
        level: change below this is drawn in a faint grey (one level for all cells).
        shown: the temporal controller shows the layer after the first day until the second.
        opacity_band: the band of the raster by which cells within their own level are pale (``opacity_band.opacity``).
        only_beyond: cells within their own level have no value.
    """
    inner = level if level is not None and 0 < level < limit else 0.0
    # a stop close to the grey band's edge would only crowd the legend
    arms = [
        (share * limit, share * limit, lowered, raised)
        for share, lowered, raised in DIVERGING
        if share * limit - inner > 0.05 * limit or not (share or inner)
    ]
    stops: list[tuple[float, Colour, int, str]] = []
    zero = f"0 {unit}" if opacity_band is None else f"0 {unit} (pale: within the cell's level of detection)"
    if only_beyond:
        zero = "no colour: compared, no change above the level"
    if inner:
        # two stops close together make the hard edge of the grey band
        arms.append((inner * 1.0001, inner, *signed_colours(inner / limit)))
        stops += [
            (-inner, BELOW_LEVEL, 70, "below the level of detection"),
            (inner, BELOW_LEVEL, 70, f"(median {inner:.3f} {unit})"),
        ]
    for value, named, lowered, raised in arms:
        if value:
            stops.append((-value, lowered, 255, f"{-named:+.3f} {unit} lowered"))
        stops.append((value, raised, 255, f"{named:+.3f} {unit} raised" if value else zero))
    return ramp_qml(sorted(stops), unit, shown, opacity_band=opacity_band)


def level_qml(limit: float, *, unit: str = "m", shown: tuple[date, date] | None = None) -> str:
    """Sequential style of a level-of-detection raster, from 0 to ``limit``; otherwise as ``change_qml``."""
    stops = [(s * limit, colour, 255, f"{s * limit:.3f} {unit}") for s, colour in SEQUENTIAL]
    return ramp_qml(stops, unit, shown)


def shade_qml(low: float, high: float) -> str:
    """Style of a hillshade: greys, black at ``low`` and white at ``high``."""
    values = (low, (low + high) / 2, max(high, low + 1.0))
    return ramp_qml([(v, (grey,) * 3, 255, f"{v:.0f}") for v, grey in zip(values, (0, 128, 255), strict=True)])


def cell_size_qml(sizes: Sequence[float]) -> str:
    """Style of a raster of cell sizes: a colour for each of the ``sizes`` (metres, ascending), lightest the finest."""
    colours = sequential_steps(len(sizes))
    return ramp_qml([(size, colour, 255, f"{size:g} m") for size, colour in zip(sizes, colours, strict=True)])


def probability_qml() -> str:
    """Style of a probability raster's first band: greys, a thin veil where nothing is likely.

    Greys, because colour is the zones' that lie over it: a bluish probability looks like uplift. The veil distinguishes
    what was screened from what was not, as on the map picture.
    """
    return ramp_qml([(s, colour, 255 if s else 120, f"{100 * s:.0f} %") for s, colour in LIKELIHOOD])


def smallest_hazard_qml() -> str:
    """Style of the raster of smallest hazards, its 3 m band first to be seen: light where low ones are found.

    The ramp ends at 1 m, beyond which nothing that screening is made for can be found.
    """
    return ramp_qml([(s, colour, 255, f"{s:.2f} m") for s, colour in SEQUENTIAL], "m", band=2)


def confirmed_qml(largest: int) -> str:
    """Style of the raster of comparisons in a row that confirm a cell, up to ``largest``: none is transparent."""
    places = np.rint(np.linspace(0, len(SEQUENTIAL) - 1, max(largest, 1) + 1)).astype(int)
    return render(_TEMPLATES / "counts.qml.j2", colours=[hexadecimal(SEQUENTIAL[place][1]) for place in places])


def seen_qml(present: Iterable[int], shown: tuple[date, date] | None = None) -> str:
    """Style of the raster of what was seen, with the classes that are ``present``; those not seen are coloured.

    ``shown``: as in ``change_qml``.
    """
    entries = [(one, hexadecimal(SEEN[one][:3]), SEEN[one][3], LABELS[one]) for one in present if one in NOT_SEEN]
    return render(_TEMPLATES / "seen.qml.j2", entries=entries, shown=_days(shown))


def zones_qml(*, located: bool = False) -> str:
    """Style of the zones by kind and severity, labelled with their ids, with aliases, map tip and a review list.

    ``located``: they have their places on a road, which are shown.
    """
    sliding = [
        _category(f"{SLIDING}, {grade}", f"{SLIDING.capitalize()}, {grade}", tint, alpha, SLIDING_LINE, width)
        for grade, tint, (_, alpha, width) in zip(SEVERITIES, SLIDING_TINTS, _LOOKS, strict=True)
    ]
    categories = [*_graded(SEVERITIES), *sliding]
    return _polygons_qml("zones", _fields(FIELDS, "zones"), categories, located=located, grade="severity")


def hazards_qml(fields: Iterable[str], *, located: bool = False) -> str:
    """Style of the screening's zones by kind and confidence, otherwise as ``zones_qml``.

    Args:
        fields: of the layer; with those of ``confirmation.FIELDS`` where a change was asked about the zones.
    """
    named = _fields(fields) | {"area_m2": {"name": "Area of the slope (m²)", "decimals": 2}}
    return _polygons_qml(
        "screened_zones", named, _graded(("high", "medium", "low")), located=located, grade="confidence"
    )


def footprints_qml() -> str:
    """Style of the footprints of the volumes: a dashed outline and a faint fill by kind, labelled with zone and
    volume.
    """
    categories = [
        _category(kind, f"Footprint of the volume, {kind}", veil, 45, line, 0.4)
        for kind, veil, line in zip(KINDS, DIVERGING[3][1:], DIVERGING[-2][1:], strict=True)
    ]
    words = f"Footprint of the volume, {SLIDING}"
    categories.append(_category(SLIDING, words, SLIDING_TINTS[2], 45, SLIDING_LINE, 0.4))
    return _polygons_qml("footprints", _fields(FOOTPRINT_FIELDS), categories)


def objects_qml(occurring: Collection[tuple[str, str]]) -> str:
    """Style of what appeared (full outline) or vanished (dashed) above the ground, with labels and map tip.

    Args:
        occurring: kinds and changes of the objects, which the legend names.
    """
    categories = [
        _category(f"{kind}, {change}", f"{kind.capitalize()}, {change}", fill, alpha if new else 0, line, width)
        | {"dash": "solid" if new else "dash"}
        for kind, fill, alpha, line, width in _OBJECT_LOOKS
        for new, change in ((True, APPEARED), (False, VANISHED))
        if (kind, change) in occurring
    ]
    return _polygons_qml("objects", _fields(OBJECT_FIELDS, "objects"), categories)


def unsure_qml() -> str:
    """Style of the groups that are no zones: grey and faint, a category for each reason, labelled with their ids."""
    categories = [_category(reason, _REASONS[reason], _GROUND, 45, (110, 110, 110), 0.3) for reason in REASONS]
    return _polygons_qml("unsure", _fields(UNSURE_FIELDS), categories)


def not_seen_qml() -> str:
    """Style of what was not seen: hatched, with the colours of the drawn maps, under one entry of the legend."""
    fill, stripe = (",".join(map(str, colour)) for colour in (UNSEEN_FILL, UNSEEN_STRIPE))
    return render(_TEMPLATES / "not_seen.qml.j2", fields=_fields(NOT_SEEN_FIELDS), fill=fill, stripe=stripe)


def series_zones_qml(alerts: Iterable[AlertLevel], *, located: bool = False) -> str:
    """Style of the tracked zones of a series by alert level, in the table's colours."""
    categories = [_outlined(str(a.level), f"{a.level} {a.name}", _rgb(a.colour), 40) for a in alerts]
    return _polygons_qml("series_zones", _fields(ZONE_FIELDS), categories, located=located)


def states_qml() -> str:
    """Style of a series' zones survey by survey: what their mean change is, shown on the days up to the survey."""
    _, lowered, raised = DIVERGING[3]
    looks = ((lowered, 170), (raised, 170), ((158, 158, 158), 60), ((255, 255, 255), 0))
    categories = [_outlined(state, state.capitalize(), *look) for state, look in zip(_STATES, looks, strict=True)]
    return _polygons_qml("series_states", SERIES_FIELDS, categories)


def corridor_zones_qml(fields: Iterable[str], *, located: bool = False) -> str:
    """Style of the zones of a corridor by their attention; ``fields`` of the layer."""
    last = len(_ATTENTION) - 1
    labels = ["No attention", *(f"Attention {n}" for n in range(1, last)), f"Attention {last} and more"]
    categories = [
        _outlined(str(n), label, colour, 30 if n == 0 else 90)
        for n, (label, colour) in enumerate(zip(labels, _ATTENTION, strict=True))
    ]
    return _polygons_qml("corridor_zones", _fields(fields), categories, located=located)


def corridor_alerts_qml(fields: Iterable[str], states: Sequence[str], entered: Sequence[str]) -> str:
    """Style of the alerts of a corridor by their state.

    Args:
        fields: of the layer.
        states: raised, acknowledged, closed and withdrawn, as they are written.
        entered: fields that people fill in.
    """
    looks = ((_ATTENTION[-2], 120), (_ATTENTION[2], 90), (_ATTENTION[0], 20), (_ATTENTION[0], 20))
    categories = [_outlined(state, f"Alert {state}", *look) for state, look in zip(states, looks, strict=True)]
    return _polygons_qml("corridor_alerts", _fields(fields), categories, states=states, entered=entered)


def drawn_qml(field: str) -> str:
    """Style of polygons to draw on or drawn by people: an outline, labelled with ``field``."""
    return render(_TEMPLATES / "drawn.qml.j2", field=field, colour="20,90,200")


def labelled_points_qml(attribute: str) -> str:
    """Style of a labelled cloud by the class in ``attribute``: 0 grey, 1 (uplift) blue, 2 (subsidence) red."""
    _, lowered, raised = DIVERGING[4]
    looks = (("Background", _GROUND), ("Uplift", raised), ("Subsidence", lowered))
    categories = [
        {"value": value, "label": label, "colour": ",".join(map(str, (*colour, 255)))}
        for value, (label, colour) in enumerate(looks)
    ]
    return render(_TEMPLATES / "labelled_points.qml.j2", attribute=attribute, categories=categories)


def write_qml_next_to(file: Path, qml: str) -> Path:
    """Write ``qml`` where QGIS finds it when it loads ``file``: same folder, same stem. Returns that path."""
    path = Path(file).with_suffix(".qml")
    with atomic_output(path) as partial:
        partial.write_text(qml, encoding="utf-8")
    return path


def ramp_qml(
    stops: Iterable[tuple[float, Colour, int, str]],
    unit: str = "",
    shown: tuple[date, date] | None = None,
    band: int = 1,
    opacity_band: int | None = None,
) -> str:
    """Style of a raster's ``band`` with ``stops``: value, colour, opacity (0 to 255) and label, values ascending."""
    return render(
        _TEMPLATES / "ramp.qml.j2",
        stops=[
            {"value": f"{value:.9g}", "colour": hexadecimal(colour), "alpha": alpha, "label": label}
            for value, colour, alpha, label in stops
        ],
        suffix=f" {unit}" if unit else "",
        band=band,
        opacity_band=opacity_band,
        shown=_days(shown),
    )


def _days(shown: tuple[date, date] | None) -> tuple[date, date] | None:
    """The first and the last day on which a layer is shown that follows a survey on the first of two days."""
    return shown and (shown[0] + timedelta(days=1), shown[1])


def classes_qml(fields: Iterable[str]) -> str:
    """Style of classes of asset by whether they lost or gained volume beyond its error, labelled with it."""
    (_, lowered, raised), (_, *lines) = DIVERGING[3], DIVERGING[-2]
    categories = [
        _category("lowering", "Class that lost volume", lowered, 60, lines[0], 0.4),
        _category("raising", "Class that gained volume", raised, 60, lines[1], 0.4),
        _category("none", "Class whose net volume is within its error", _GROUND, 30, (110, 110, 110), 0.3),
    ]
    return _polygons_qml("classes", _fields(fields), categories)


def _polygons_qml(
    template: str,
    fields: Mapping[str, Any],
    categories: Sequence[dict[str, Any]],
    *,
    located: bool = False,
    **more: Any,
) -> str:
    return render(
        _TEMPLATES / f"{template}.qml.j2",
        fields=fields,
        categories=categories,
        hidden=("slope_id",) if located else (*PLACE_FIELDS, *LOCATION_FIELDS),
        located=located,
        review_states=STATES,
        **({"entered": REVIEW_FIELDS} | more),
    )


def _fields(names: Iterable[str], table: str = "") -> dict[str, dict[str, Any]]:
    """What analysts read instead of each field's name, and with how many decimals its figures.

    Where a field is another thing in one ``table``, that has its own name as ``table.field``.
    """
    known = json.loads((_TEMPLATES / "fields.json").read_text(encoding="utf-8"))
    return {name: known.get(f"{table}.{name}") or known[name] for name in names}


def _graded(grades: Sequence[str]) -> list[dict[str, Any]]:
    """Categories by kind and grade, from the highest grade on."""
    return [
        _category(f"{kind}, {grade}", f"{kind.capitalize()}, {grade}", veil[arm], alpha, DIVERGING[-1][1:][arm], width)
        for arm, kind in enumerate(KINDS)
        for grade, (veil, alpha, width) in zip(grades, _LOOKS, strict=False)
    ]


def _rgb(colour: str) -> Colour:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def _outlined(value: str, label: str, colour: Colour, alpha: int) -> dict[str, Any]:
    red, green, blue = (band * 3 // 4 for band in colour)
    return _category(value, label, colour, alpha, (red, green, blue), 0.8)


def _category(value: str, label: str, fill: Colour, alpha: int, line: Colour, width: float) -> dict[str, Any]:
    """A category and its symbol: colour and opacity (0 to 255) of the fill, colour and width (mm) of the line."""
    return {
        "value": value,
        "label": label,
        "fill": ",".join(map(str, (*fill, alpha))),
        "line": ",".join(map(str, line)),
        "width": width,
    }
