"""QGIS's styles as Styled Layer Descriptors (OGC SLD 1.0), for other programs: colours, outlines, classes and labels.

What SLD cannot say is left out: outlines that are computed, seams, map tips, days of the temporal controller.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from ..core.templates import render

_TEMPLATES = Path(__file__).resolve().parent / "templates"
_MM_PX = 1 / 0.28
"""SLD's pixel is 0.28 mm wide."""
_PAIR = re.compile(r"""concat\("([^"]+)", ', ', "([^"]+)"\)""")
_CAPPED = re.compile(r"""min\("([^"]+)", (\d+)\)""")
_FIELD = re.compile(r'"?([^"()]+)"?')
_KINDS = {"0": "point", "1": "line", "2": "polygon"}


@dataclass(frozen=True)
class Condition:
    """A field, how it is compared (as SLD calls it), and with what."""

    field: str
    comparison: str
    value: str


@dataclass(frozen=True)
class Look:
    """Fill and line of a class: colours ``#rrggbb``, opacities 0 to 1 (0: none), width in pixels; ``hatched`` with
    ``line`` in place of an outline.
    """

    fill: str
    fill_opacity: float
    line: str
    line_width: float
    dashed: bool
    hatched: bool = False


@dataclass(frozen=True)
class Rule:
    """A class of a layer: its title, the conditions that all hold in it, and its look."""

    title: str
    conditions: tuple[Condition, ...]
    look: Look


def sld_of(qml: str, name: str) -> str:
    """The SLD of a layer ``name`` with this QGIS style; empty where SLD has no words for it."""
    if not qml:
        return ""
    root = ElementTree.fromstring(qml)
    if (ramp := root.find(".//rasterrenderer[@type='singlebandpseudocolor']")) is not None:
        return _raster(ramp, name)
    renderer = root.find("renderer-v2")
    rules = [] if renderer is None else _rules(renderer)
    if not rules:
        return ""
    label = root.find("labeling/settings/text-style[@isExpression='0']")
    return render(
        _TEMPLATES / "vector.sld.j2",
        name=name,
        rules=rules,
        kind=_KINDS.get(root.findtext("layerGeometryType", "2"), "polygon"),
        label="" if label is None else label.get("fieldName", ""),
    )


def _raster(ramp: Element, name: str) -> str:
    stops = [
        {
            "value": item.get("value"),
            "colour": item.get("color"),
            "opacity": f"{int(item.get('alpha', '255')) / 255:.3f}",
            "label": item.get("label", ""),
        }
        for item in ramp.iter("item")
    ]
    return render(_TEMPLATES / "raster.sld.j2", name=name, band=ramp.get("band", "1"), stops=stops)


def _rules(renderer: Element) -> list[Rule]:
    looks = {symbol.get("name", ""): _look(symbol) for symbol in renderer.findall("symbols/symbol")}
    if renderer.get("type") == "singleSymbol":
        return [Rule("", (), look) for look in looks.values()]
    rules = []
    for category in renderer.findall("categories/category"):
        conditions = _conditions(renderer.get("attr", ""), category.get("value", ""))
        look = looks.get(category.get("symbol", ""))
        if not conditions or look is None:
            return []
        rules.append(Rule(category.get("label", ""), conditions, look))
    return rules


def _conditions(attribute: str, value: str) -> tuple[Condition, ...]:
    """What holds where the styles' expression ``attribute`` is ``value``; empty where SLD has no words for it."""
    if found := _PAIR.fullmatch(attribute):
        parts = value.split(", ", 1)
        return tuple(
            Condition(field, "PropertyIsEqualTo", part) for field, part in zip(found.groups(), parts, strict=True)
        )
    if found := _CAPPED.fullmatch(attribute):
        comparison = "PropertyIsGreaterThanOrEqualTo" if value == found[2] else "PropertyIsEqualTo"
        return (Condition(found[1], comparison, value),)
    if found := _FIELD.fullmatch(attribute):
        return (Condition(found[1], "PropertyIsEqualTo", value),)
    return ()


def _look(symbol: Element) -> Look:
    fills = [_options(part) for part in symbol.iter("layer") if part.get("class") == "SimpleFill"]
    lines = [_options(part) for part in symbol.iter("layer") if part.get("class") == "SimpleLine"]
    own = fills[0] if fills else {}
    fill, fill_opacity = _colour(own.get("color", "")) if own.get("style") == "solid" else ("#000000", 0.0)
    if lines:
        # the last is drawn on top of the light seam
        line, width, dashed = (
            lines[-1].get("line_color", ""),
            lines[-1].get("line_width", "0.3"),
            lines[-1].get("line_style"),
        )
    else:
        line, width, dashed = own.get("outline_color", ""), own.get("outline_width", "0.3"), own.get("outline_style")
    hatched = any(part.get("class") == "LinePatternFill" for part in symbol.iter("layer"))
    return Look(fill, fill_opacity, _colour(line)[0], round(float(width) * _MM_PX, 2), dashed == "dash", hatched)


def _options(part: Element) -> dict[str, str]:
    return {option.get("name", ""): option.get("value", "") for option in part.findall("Option/Option")}


def _colour(text: str) -> tuple[str, float]:
    """``R,G,B,A`` as ``#rrggbb`` and opacity; black where it is none."""
    parts: Sequence[str] = text.split(",")
    try:
        red, green, blue = (int(part) for part in parts[:3])
        return f"#{red:02x}{green:02x}{blue:02x}", round(int(parts[3]) / 255, 3) if len(parts) > 3 else 1.0
    except ValueError:
        return "#000000", 1.0
