"""What the schema of LandXML 1.2 (LandXML-1.2.xsd of 2008-07-29) says of the elements that are handed over.

Read off the schema by hand: it is not part of the tests, because its copies state no licence. An element that is not
here, an attribute that the schema does not have, or a child out of its order is a fault.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import date, time
from itertools import groupby
from pathlib import Path
from xml.etree import ElementTree

NAMESPACE = "{http://www.landxml.org/schema/LandXML-1.2}"
_INSTANCE = "{http://www.w3.org/2001/XMLSchema-instance}schemaLocation"
Check = Callable[[str], object]


def _text(value: str) -> object:
    return value


def _one_of(*words: str) -> Check:
    def check(value: str) -> object:
        if value not in words:
            raise ValueError(f"{value} is none of {words}")
        return value

    return check


def _numbers(least: int, most: int | None = None, kind: Callable[[str], object] = float) -> Check:
    def check(value: str) -> object:
        found = [kind(word) for word in value.split()]
        if len(found) < least or (most is not None and len(found) > most):
            raise ValueError(f"{len(found)} numbers, not {least} to {most}")
        return found

    return check


def _positive(value: str) -> object:
    if not re.fullmatch(r"\+?0*[1-9]\d*", value):
        raise ValueError(f"{value} is no positive whole number")
    return value


_ANGLE = _one_of("radians", "grads", "decimal degrees", "decimal dd.mm.ss")


@dataclass(frozen=True)
class Rule:
    """``order`` are the children in the schema's sequence with the fewest and most of each, None: no bound;
    ``mixed`` is a choice in any order. ``unique`` is an element whose names must differ.
    """

    needs: dict[str, Check] = field(default_factory=dict)
    may: dict[str, Check] = field(default_factory=dict)
    order: tuple[tuple[str, int, int | None], ...] = ()
    mixed: tuple[str, ...] = ()
    content: Check | None = None
    unique: str = ""
    key: str = "name"


_FEATURES = ("Feature", 0, None)
_POINT = {"name": _text, "desc": _text, "code": _text, "pntRef": _text}
RULES = {
    "LandXML": Rule(
        {"date": date.fromisoformat, "time": time.fromisoformat, "version": _text},
        {"language": _text, "readOnly": _one_of("true", "false", "0", "1"), _INSTANCE: _text},
        mixed=("Units", "CoordinateSystem", "Project", "Application", "Alignments", "PlanFeatures", "Surfaces"),
    ),
    "Units": Rule(mixed=("Metric",)),
    "Metric": Rule(
        {
            "areaUnit": _one_of("hectare", "squareMeter", "squareMillimeter", "squareCentimeter"),
            "linearUnit": _one_of("millimeter", "centimeter", "meter", "kilometer"),
            "volumeUnit": _one_of("cubicMeter", "liter", "hectareMeter"),
            "temperatureUnit": _one_of("celsius", "kelvin"),
            "pressureUnit": _one_of("HPA", "milliBars", "mmHG", "millimeterHG"),
        },
        {"angularUnit": _ANGLE, "directionUnit": _ANGLE},
    ),
    "CoordinateSystem": Rule(
        may=dict.fromkeys(("desc", "name", "epsgCode", "ogcWktCode", "horizontalDatum", "verticalDatum"), _text)
    ),
    "Project": Rule({"name": _text}, {"desc": _text}, mixed=("Feature",)),
    "Application": Rule({"name": _text}, dict.fromkeys(("desc", "manufacturer", "version", "manufacturerURL"), _text)),
    "Surfaces": Rule(may={"name": _text, "desc": _text}, order=(("Surface", 1, None), _FEATURES), unique="Surface"),
    "Surface": Rule({"name": _text}, {"desc": _text, "OID": _text}, order=(("Definition", 0, 3), _FEATURES)),
    "Definition": Rule(
        {"surfType": _one_of("TIN", "grid")},
        dict.fromkeys(("area2DSurf", "area3DSurf", "elevMax", "elevMin"), float),
        order=(("Pnts", 1, 1), ("Faces", 1, None), _FEATURES),
    ),
    "Pnts": Rule(order=(("P", 3, None),), unique="P", key="id"),
    "P": Rule({"id": _positive}, _POINT, content=_numbers(3, 3)),
    "Faces": Rule(may={"name": _text, "desc": _text}, order=(("F", 1, None), _FEATURES)),
    "F": Rule(may={"i": int, "b": _positive}, content=_numbers(3, 4, int)),
    "Alignments": Rule(
        may={"name": _text, "desc": _text}, order=(("Alignment", 1, None), _FEATURES), unique="Alignment"
    ),
    "Alignment": Rule(
        {"name": _text, "length": float, "staStart": float}, {"desc": _text}, mixed=("CoordGeom", "Profile", "Feature")
    ),
    "CoordGeom": Rule(may={"name": _text, "desc": _text}, order=(("Line", 0, None), _FEATURES)),
    "Line": Rule(
        may={"name": _text, "desc": _text, "length": float}, order=(("Start", 1, 1), ("End", 1, 1), _FEATURES)
    ),
    "Start": Rule(may=_POINT, content=_numbers(0, 3)),
    "End": Rule(may=_POINT, content=_numbers(0, 3)),
    "Profile": Rule(may={"name": _text, "desc": _text, "staStart": float}, order=(("ProfSurf", 0, None), _FEATURES)),
    "ProfSurf": Rule({"name": _text}, {"desc": _text}, order=(("PntList2D", 1, None), _FEATURES)),
    "PntList2D": Rule(content=_numbers(2)),
    "PlanFeatures": Rule(may={"name": _text, "desc": _text}, order=(("PlanFeature", 1, None), _FEATURES)),
    "PlanFeature": Rule(may={"name": _text, "desc": _text}, mixed=("CoordGeom", "Location", "Feature")),
    "Feature": Rule(
        may={"name": _text, "code": _text, "source": _text},
        order=(("Property", 0, None), ("DocFileRef", 0, None), _FEATURES),
    ),
    "Property": Rule({"label": _text, "value": _text}),
}


def faults(path: Path) -> list[str]:
    """A sentence for each fault of a document; none where it keeps to the rules."""
    root = ElementTree.parse(path).getroot()
    return _faults(root)


def _faults(element: ElementTree.Element) -> list[str]:
    name = element.tag.removeprefix(NAMESPACE)
    rule = RULES.get(name)
    if rule is None:
        return [f"{name} is not expected"]
    found = [f"{name} lacks {word}" for word in rule.needs if word not in element.attrib]
    for word, value in element.attrib.items():
        check = rule.needs.get(word) or rule.may.get(word)
        found += [f"{name} has {word}"] if check is None else _tried(f"{name}/{word}", check, value)
    text = (element.text or "").strip()
    if rule.content is not None:
        found += _tried(name, rule.content, text)
    elif text:
        found.append(f"{name} holds text")
    children = [child.tag.removeprefix(NAMESPACE) for child in element]
    found += _order(name, rule, children)
    named = [child.get(rule.key) for child in element if child.tag == f"{NAMESPACE}{rule.unique}"]
    if len(set(named)) < len(named):
        found.append(f"{name} has two {rule.unique} of one {rule.key}")
    return found + [fault for child in element for fault in _faults(child)]


def _tried(where: str, check: Check, value: str) -> list[str]:
    try:
        check(value)
    except ValueError as error:
        return [f"{where}: {error}"]
    return []


def _order(name: str, rule: Rule, children: list[str]) -> list[str]:
    if rule.mixed:
        return [f"{name} has the child {child}" for child in children if child not in rule.mixed]
    allowed = [child for child, _, _ in rule.order]
    runs = [child for child, _ in groupby(children)]
    found = [f"{name} has the child {child}" for child in runs if child not in allowed]
    places = [allowed.index(child) for child in runs if child in allowed]
    if places != sorted(places) or len(set(places)) < len(places):
        found.append(f"{name} has its children out of order")
    for child, least, most in rule.order:
        count = children.count(child)
        if count < least or (most is not None and count > most):
            found.append(f"{name} has {count} {child}")
    return found
