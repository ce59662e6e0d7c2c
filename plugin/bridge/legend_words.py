"""Words of a print layout's legend in lines that fit into its column."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsLayerTreeLayer, QgsLayoutItemLegend, QgsMapLayerLegendUtils
from qgis.PyQt.QtGui import QFont, QFontMetricsF

_MM_A_POINT = 25.4 / 72.0
_EM = 200  # pixels, at which words are measured
_GAPS_MM = 6.0  # around the symbol
_DISPLAYED = 0  # Qt's role of what is displayed


def fit_names(item: QgsLayoutItemLegend, width: float, sizes: tuple[float, float]) -> None:
    """Break names of layers and of their classes that are wider than the legend's column.

    Args:
        width: of the column, millimetres, from the edge of the symbols.
        sizes: of the letters of layers and classes, points.
    """
    next_to = width - item.symbolWidth() - _GAPS_MM
    model = item.model()
    for node in model.rootGroup().findLayers():
        classes = model.layerLegendNodes(node)
        # a layer of one symbol has its name next to the symbol, in the letters of a class
        alone = len(classes) == 1 and classes[0].isEmbeddedInParent()
        size, room = (sizes[1], next_to) if alone else (sizes[0], width)
        node.setCustomProperty("legend/title-label", in_lines(node.name(), room, size))
        _fit_classes(model, node, classes, next_to, sizes[1])


def _fit_classes(model: Any, node: QgsLayerTreeLayer, classes: list[Any], width: float, size: float) -> None:
    changed = False
    for number, one in enumerate(classes):
        label = str(one.data(_DISPLAYED) or "")
        lines = in_lines(label, width, size)
        if lines != label:
            QgsMapLayerLegendUtils.setLegendNodeUserLabel(node, _place(node, number), lines)
            changed = True
    if changed:
        model.refreshLayerLegend(node)


def _place(node: QgsLayerTreeLayer, number: int) -> int:
    """The place among all classes of a layer of one of those that the legend shows."""
    order = QgsMapLayerLegendUtils.legendNodeOrder(node)
    return order[number] if number < len(order) else number


def in_lines(text: str, width: float, size: float) -> str:
    """Text with line breaks so that no line is wider than ``width`` millimetres in letters of ``size`` points, as far
    as its words are not wider; text without blanks is broken anywhere.
    """
    font = QFont()
    font.setPixelSize(_EM)
    metrics = QFontMetricsF(font)

    def fits(words: str) -> bool:
        return metrics.horizontalAdvance(words) / _EM * size * _MM_A_POINT <= width

    if fits(text):
        return text
    parts, joint = (text.split(" "), " ") if " " in text else (list(text), "")
    lines = [parts[0]]
    for part in parts[1:]:
        longer = lines[-1] + joint + part
        if fits(longer):
            lines[-1] = longer
        else:
            lines.append(part)
    return "\n".join(lines)
