"""What a style says, read from its XML."""

from __future__ import annotations

from xml.etree import ElementTree


def stops(qml: str) -> list[tuple[float, str, int, str]]:
    items = ElementTree.fromstring(qml).iter("item")
    return [(float(i.get("value")), i.get("color"), int(i.get("alpha")), i.get("label")) for i in items]
