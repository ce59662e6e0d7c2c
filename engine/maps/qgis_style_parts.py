"""What the styles of all layers of zones share: labels, attribute table, forms, the document around them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from ..vector.review_fields import PLACE_FIELDS, REVIEW_FIELDS, STATES

VERSION = "3.34.0"
"""Of QGIS, the oldest that the styles are for."""
HEAD = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"


def categorized(attribute: str, also: str = "") -> tuple[Element, Element, Element]:
    """The root of a style of polygons by ``attribute`` (a field or an expression), and what takes its categories and
    their symbols.

    Args:
        also: parts of a style that it has in addition to those that all have, such as ``|Temporal``.
    """
    root = Element(
        "qgis",
        version=VERSION,
        styleCategories=f"Symbology|Labeling|Fields|Forms|MapTips|AttributeTable{also}",
        labelsEnabled="1",
        readOnly="0",
    )
    renderer = SubElement(
        root,
        "renderer-v2",
        {
            "type": "categorizedSymbol",
            "attr": attribute,
            "enableorderby": "0",
            "forceraster": "0",
            "symbollevels": "0",
            "referencescale": "-1",
        },
    )
    return root, SubElement(renderer, "categories"), SubElement(renderer, "symbols")


def labels(root: Element, text: str = "") -> None:
    """Zones are labelled with their ids, or with what the expression ``text`` makes of their fields."""
    settings = SubElement(SubElement(root, "labeling", type="simple"), "settings", calloutType="simple")
    style = SubElement(
        settings,
        "text-style",
        fieldName=text or "zone_id",
        isExpression="1" if text else "0",
        fontSize="8",
        fontSizeUnit="Point",
        fontFamily="Open Sans",
        fontWeight="63",
        textColor="30,30,30,255",
        textOpacity="1",
        allowHtml="0",
    )
    SubElement(
        style,
        "text-buffer",
        bufferDraw="1",
        bufferSize="0.8",
        bufferSizeUnits="MM",
        bufferColor="255,255,255,255",
        bufferOpacity="0.85",
        bufferNoFill="1",
    )
    SubElement(settings, "placement", placement="1", centroidInside="1", centroidWhole="1", priority="5", dist="0")
    SubElement(settings, "rendering", drawLabels="1", obstacle="1", scaleVisibility="0", labelPerPart="0")


def attribute_table(root: Element, aliases: dict[str, str], first: tuple[str, ...]) -> None:
    """The attribute table begins with what is read first; where a zone lies by the register is hidden until then."""
    columns = SubElement(SubElement(root, "attributetableconfig", sortOrder="0"), "columns")
    for field in [*first, *(f for f in aliases if f not in first)]:
        hidden = "1" if field in PLACE_FIELDS else "0"
        width = str(max(80, 30 + 7 * len(aliases[field])))  # pixels; QGIS itself cuts long headings
        SubElement(columns, "column", type="field", name=field, hidden=hidden, width=width)


def forms(root: Element, names: Mapping[str, str], decimals: Mapping[str, int]) -> None:
    """Names of the fields, decimals of the measured ones, and what to enter a review with; only that can be edited.

    Args:
        names: by field.
        decimals: by the end or the beginning of a field's name.
    """
    configuration = SubElement(root, "fieldConfiguration")
    if "review_status" in names:
        _review(SubElement(configuration, "field", name="review_status"))
    if "remarks" in names:
        _remarks(SubElement(configuration, "field", name="remarks"))
    # the form would also write the rounded figure back
    read_only(root, (name for name in names if name not in REVIEW_FIELDS))
    for field in names:
        places = next((n for part, n in decimals.items() if field.endswith(part) or field.startswith(part)), None)
        if places is None:
            continue
        widget = SubElement(SubElement(configuration, "field", name=field), "editWidget", type="Range")
        precision = SubElement(SubElement(widget, "config"), "Option", type="Map")
        SubElement(precision, "Option", type="int", name="Precision", value=str(places))
    aliases = SubElement(root, "aliases")
    for field, name in names.items():
        SubElement(aliases, "alias", field=field, name=name)


def read_only(root: Element, names: Iterable[str]) -> None:
    """Fields that the form shows and does not let be edited."""
    editable = SubElement(root, "editable")
    for name in names:
        SubElement(editable, "field", name=name, editable="0")


def _review(field: Element) -> None:
    widget = SubElement(field, "editWidget", type="ValueMap")
    listed = SubElement(SubElement(widget, "config"), "Option", type="Map")
    choices = SubElement(listed, "Option", type="List", name="map")
    for status in STATES:
        entry = SubElement(choices, "Option", type="Map")
        SubElement(entry, "Option", type="QString", name=status.capitalize(), value=status)


def _remarks(field: Element) -> None:
    widget = SubElement(field, "editWidget", type="TextEdit")
    settings = SubElement(SubElement(widget, "config"), "Option", type="Map")
    SubElement(settings, "Option", type="bool", name="IsMultiline", value="true")


def options(parent: Element, **values: str) -> None:
    """Settings of a symbol's layer."""
    option = SubElement(parent, "Option", type="Map")
    for name, value in values.items():
        SubElement(option, "Option", type="QString", name=name, value=value)


def document(root: Element) -> str:
    """The style as QGIS reads it."""
    ElementTree.indent(root)
    return f"{HEAD}{ElementTree.tostring(root, encoding='unicode')}\n"
