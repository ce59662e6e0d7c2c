"""Layers under the names that were agreed on: of their fields, and in the styles that name these."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from xml.etree import ElementTree

import geopandas as gpd

from ..core.errors import InputError
from ..core.messages import shown
from .held import HeldLayer

_NAMED_BY = ("attr", "field", "fieldName", "startField", "endField")
"""Attributes of a QGIS style whose value is the name of a field."""
_DOCTYPE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"


def renamed_layers(layers: Iterable[HeldLayer], names: Mapping[str, str]) -> tuple[HeldLayer, ...]:
    """The layers with their fields renamed; ``names`` as of ``read_field_mapping``.

    Raises:
        InputError: two fields of a layer would have one name.
    """
    return tuple(_renamed(layer, names) for layer in layers)


def unknown_names(layers: Iterable[HeldLayer], names: Mapping[str, str]) -> list[str]:
    """Those of our names that no layer has as a field."""
    known = {name for layer in layers for field in _fields(layer) for name in (field, f"{layer.name}.{field}")}
    return [name for name in names if name not in known]


def _fields(layer: HeldLayer) -> list[str]:
    geometry = layer.frame.geometry.name if isinstance(layer.frame, gpd.GeoDataFrame) else None
    return [name for name in layer.frame.columns if name != geometry]


def _renamed(layer: HeldLayer, names: Mapping[str, str]) -> HeldLayer:
    new = {field: names.get(f"{layer.name}.{field}", names.get(field, field)) for field in _fields(layer)}
    seen: dict[str, str] = {}
    for ours, theirs in new.items():
        if theirs.lower() in seen:
            raise InputError(
                f"The fields {seen[theirs.lower()]} and {ours} of {layer.name} would both be named {shown(theirs)}; "
                "give each a name of its own in the mapping file."
            )
        seen[theirs.lower()] = ours
    changed = {ours: theirs for ours, theirs in new.items() if ours != theirs}
    if not changed:
        return layer
    return replace(layer, frame=layer.frame.rename(columns=changed), qml=renamed_qml(layer.qml, changed))


def renamed_qml(qml: str, names: Mapping[str, str]) -> str:
    """A QGIS style whose fields have other names: where a field is named, and in expressions."""
    if not qml or not names:
        return qml
    root = ElementTree.fromstring(qml)
    quoted = re.compile('"(' + "|".join(map(re.escape, names)) + ')"')

    def in_expression(text: str) -> str:
        return quoted.sub(lambda found: f'"{names[found[1]]}"', text)

    for element in root.iter():
        for key, value in element.attrib.items():
            is_name = key in _NAMED_BY or (key == "name" and element.tag in ("column", "field"))
            element.set(key, names.get(value, in_expression(value)) if is_name else in_expression(value))
        if element.text:
            element.text = in_expression(element.text)
    return _DOCTYPE + ElementTree.tostring(root, encoding="unicode") + "\n"
