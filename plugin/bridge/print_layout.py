"""The print layout of a project: map, legend, scale bar, north arrow, table of the zones, title block."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from qgis.core import (
    NULL,
    QgsFillSymbol,
    QgsLayerTreeGroup,
    QgsLayerTreeLayer,
    QgsLayoutFrame,
    QgsLayoutItem,
    QgsLayoutItemAttributeTable,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsLayoutItemMap,
    QgsLayoutItemPicture,
    QgsLayoutItemScaleBar,
    QgsLayoutItemShape,
    QgsLayoutMeasurement,
    QgsLayoutPoint,
    QgsLayoutSize,
    QgsLayoutTableColumn,
    QgsLegendRenderer,
    QgsLegendStyle,
    QgsMapLayerLegendUtils,
    QgsPrintLayout,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
    QgsScaleBarSettings,
    QgsSimpleFillSymbolLayer,
    QgsTextFormat,
    QgsUnitTypes,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QColor

from .legend_words import fit_names
from .words import tr

LAYOUT = "SlopeWatch"
"""The layout's name, the same in every language: scripts name it."""
PAPERS = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
"""Width and height in millimetres."""
_MARGIN_MM, _GAP_MM = 10.0, 4.0
_SIDE_SHARE, _TABLE_SHARE, _BLOCK_MM = 0.24, 0.28, 24.0
"""Shares of the sheet's width for the legend and of its height for the table at most; height of the title block."""
_ROW_MM = 4.9
"""Height of a row of the table."""
_COLUMNS = (
    ("zone_id", "Zone", ""), ("slope", "Slope", ""), ("kind", "Kind", ""), ("severity", "Severity", ""),
    ("alert", "Alert", ""), ("area_m2", "Area", "m²"), ("dz_mean_m", "Mean change", "m"),
    ("rate_mm_day", "Rate", "mm/day"), ("motion_rate_mm_day", "Along the surface", "mm/day"),
    ("motion_rate_err", "±", "mm/day"), ("vol_net_m3", "Volume", "m³"), ("vol_err_m3", "±", "m³"),
    ("motion_m", "Motion", "m"), ("motion_err_m", "±", "m"),
    ("length_m", "Motion", "m"), ("length_err_m", "±", "m"), ("azimuth_deg", "Direction", "°"), ("route", "Route", ""),
    ("chain_from", "Chainage from", ""), ("chain_to", "Chainage to", ""),
)  # fmt: skip
"""Fields of zones, what is said above them, and their unit."""
_VALUES = {"kind": ("uplift", "subsidence", "sliding"), "severity": ("high", "moderate", "low", "unsure")}
"""Values that are shown in words of QGIS's language."""
_DECIMALS = {
    "area_m2": 1, "dz_mean_m": 3, "rate_mm_day": 2, "vol_net_m3": 2, "vol_err_m3": 2, "motion_m": 3, "motion_err_m": 3,
    "motion_rate_mm_day": 2, "motion_rate_err": 2, "length_m": 3, "length_err_m": 3, "azimuth_deg": 0,
}  # fmt: skip
_WIDE_COLUMNS = 12
_LAYER_POINTS, _CLASS_POINTS = 8, 7
"""Letters of the legend."""
_NORTH = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 20 28"><path d="M10 1 L17 25 L10 20 L3 25 Z" fill="none" '
    'stroke="#222" stroke-width="1"/><path d="M10 1 L10 20 L3 25 Z" fill="#222"/></svg>'
)
_EVALUATED = re.compile(r"\[%|\$CURRENT_DATE")
"""What begins a part that QGIS replaces in a label."""
_MM = QgsUnitTypes.LayoutUnit.LayoutMillimeters


@dataclass(frozen=True)
class Sheet:
    """Texts of the title block, and the paper: a key of ``PAPERS``."""

    title: str
    subtitle: str
    author: str
    source: str
    paper: str


def add_sheet(
    project: QgsProject, sheet: Sheet, extent: QgsRectangle, layers: Sequence[Any], zones: QgsVectorLayer | None
) -> str:
    """Add the layout to a project; its name.

    Args:
        extent: what the map shows at least, in the project's system.
        layers: what the map draws, from the top on.
        zones: the layer whose features are listed; None for none.
    """
    layout = QgsPrintLayout(project)
    layout.initializeDefaults()
    layout.setName(LAYOUT)
    width, height = PAPERS[sheet.paper]
    layout.pageCollection().page(0).setPageSize(QgsLayoutSize(width, height, _MM))
    side, inner = _SIDE_SHARE * width, height - 2 * _MARGIN_MM
    count = zones.featureCount() if zones is not None else 0
    rows = min(count, int(_TABLE_SHARE * height / _ROW_MM) - 1)
    table = (rows + 1) * _ROW_MM + (_GAP_MM if rows else 0.0) if count else 0.0
    map_width = width - 2 * _MARGIN_MM - side - _GAP_MM
    column = inner - _BLOCK_MM - _GAP_MM
    drawn = _add_map(layout, (_MARGIN_MM, _MARGIN_MM, map_width, column - table), extent, layers)
    left, top = _MARGIN_MM + map_width + _GAP_MM, _MARGIN_MM
    _add_north(layout, (left + side - 16, top, 14.0, 18.0))
    _add_scale(layout, drawn, (left, top + 2, side - 20, 14.0))
    _add_legend(layout, drawn, (left, top + 20, side, column - 20))
    if count and zones is not None:
        place = (_MARGIN_MM, _MARGIN_MM + column - table + _GAP_MM, map_width, table - _GAP_MM)
        _add_table(layout, zones, place, rows)
    _add_block(layout, sheet, (_MARGIN_MM, height - _MARGIN_MM - _BLOCK_MM, width - 2 * _MARGIN_MM, _BLOCK_MM))
    project.layoutManager().addLayout(layout)
    return LAYOUT


Box = tuple[float, float, float, float]
"""Left, top, width and height in millimetres."""


def _place(layout: QgsPrintLayout, item: QgsLayoutItem, box: Box) -> None:
    layout.addLayoutItem(item)
    item.attemptMove(QgsLayoutPoint(box[0], box[1], _MM))
    item.attemptResize(QgsLayoutSize(box[2], box[3], _MM))


def _add_map(layout: QgsPrintLayout, box: Box, extent: QgsRectangle, layers: Sequence[Any]) -> QgsLayoutItemMap:
    item = QgsLayoutItemMap(layout)
    item.setId("map")
    _place(layout, item, box)
    item.setFrameEnabled(True)
    item.setFrameStrokeWidth(QgsLayoutMeasurement(0.2, _MM))
    item.setBackgroundColor(QColor("white"))
    item.setLayers(list(layers))
    item.setKeepLayerSet(True)
    item.zoomToExtent(extent)
    return item


def _add_north(layout: QgsPrintLayout, box: Box) -> None:
    item = QgsLayoutItemPicture(layout)
    item.setId("north")
    # inside of the project: a path to a picture would not move with it
    item.setPicturePath("base64:" + base64.b64encode(_NORTH.encode()).decode())
    _place(layout, item, (box[0], box[1] + 4, box[2], box[3] - 4))
    _add_text(layout, "N", (box[0], box[1] - 1, box[2], 5.0), 9, centred=True)


def _add_scale(layout: QgsPrintLayout, drawn: QgsLayoutItemMap, box: Box) -> None:
    item = QgsLayoutItemScaleBar(layout)
    item.setId("scale")
    item.setStyle("Single Box")
    item.setLinkedMap(drawn)
    item.setUnits(QgsUnitTypes.DistanceUnit.DistanceMeters)
    item.setUnitLabel("m")
    item.setNumberOfSegments(2)
    item.setNumberOfSegmentsLeft(0)
    item.setSegmentSizeMode(QgsScaleBarSettings.SegmentSizeMode.SegmentSizeFitWidth)
    item.setMinimumBarWidth(0.35 * box[2])
    item.setMaximumBarWidth(0.75 * box[2])
    item.setTextFormat(_format(8))
    _place(layout, item, box)
    item.update()


def _add_legend(layout: QgsPrintLayout, drawn: QgsLayoutItemMap, box: Box) -> None:
    item = QgsLayoutItemLegend(layout)
    item.setId("legend")
    item.setLinkedMap(drawn)
    item.setAutoUpdateModel(False)
    shown = {layer.id() for layer in drawn.layers()}
    _prune(item.model().rootGroup(), shown)
    for node in item.model().rootGroup().findLayers():
        _without_band(item, node)
    item.setLegendFilterByMapEnabled(True)  # of the classes of zones, those that are there
    for style, size in (
        (QgsLegendStyle.Style.Title, 11), (QgsLegendStyle.Style.Group, 9),
        (QgsLegendStyle.Style.Subgroup, _LAYER_POINTS), (QgsLegendStyle.Style.SymbolLabel, _CLASS_POINTS),
    ):  # fmt: skip
        legend_style = item.style(style)
        legend_style.setTextFormat(_format(size))
        item.setStyle(style, legend_style)
    item.setTitle(tr("Legend"))
    item.setSymbolHeight(2.6)
    item.setSymbolWidth(5.0)
    item.setWrapString("\n")
    fit_names(item, box[2], (_LAYER_POINTS, _CLASS_POINTS))
    item.setResizeToContents(True)
    _place(layout, item, box)
    item.adjustBoxSize()


def _prune(group: QgsLayerTreeGroup, shown: set[str]) -> None:
    """Take what the map does not draw out of a legend, and pictures, which have no legend."""
    for child in list(group.children()):
        if isinstance(child, QgsLayerTreeGroup):
            _prune(child, shown)
            if not child.children():
                group.removeChildNode(child)
            else:
                QgsLegendRenderer.setNodeLegendStyle(child, QgsLegendStyle.Style.Hidden)
        elif child.layerId() not in shown or _is_picture(child.layer()):
            group.removeChildNode(child)


def _is_picture(layer: Any) -> bool:
    return isinstance(layer, QgsRasterLayer) and layer.renderer().type() == "multibandcolor"


def _without_band(item: QgsLayoutItemLegend, node: QgsLayerTreeLayer) -> None:
    """Without the name of a raster's band, which stands above its colours."""
    if isinstance(node.layer(), QgsRasterLayer):
        count = len(item.model().layerLegendNodes(node))
        QgsMapLayerLegendUtils.setLegendNodeOrder(node, list(range(1, count)))
        item.model().refreshLayerLegend(node)


def _add_table(layout: QgsPrintLayout, zones: QgsVectorLayer, box: Box, rows: int) -> None:
    """The first zones; where not all fit, the sheet says how many there are."""
    table = QgsLayoutItemAttributeTable.create(layout)
    layout.addMultiFrame(table)
    table.setVectorLayer(zones)
    shown = [column for column in _COLUMNS if _is_filled(zones, column[0])][:_WIDE_COLUMNS]
    columns = []
    two_rates = any(field == "motion_rate_mm_day" for field, *_ in shown)
    for field, name, unit in shown:
        title = "Rate of the heights" if two_rates and field == "rate_mm_day" else name
        column = QgsLayoutTableColumn(f"{tr(title)} ({tr(unit)})" if unit else tr(title))
        decimals = _DECIMALS.get(field)
        column.setAttribute(_in_words(field) if decimals is None else _number(field, decimals))
        column.setHAlignment(Qt.AlignmentFlag.AlignLeft if decimals is None else Qt.AlignmentFlag.AlignRight)
        columns.append(column)
    table.setColumns(columns)
    table.setMaximumNumberOfFeatures(rows)
    table.setContentTextFormat(_format(7))
    table.setHeaderTextFormat(_format(7, bold=True))
    table.setGridStrokeWidth(0.1)
    table.setCellMargin(0.7)
    frame = QgsLayoutFrame(layout, table)
    frame.setId("zones")
    _place(layout, frame, box)
    table.addFrame(frame)
    table.recalculateFrameSizes()
    if rows < zones.featureCount():
        words = tr("{0} of {1} zones").format(rows, zones.featureCount())
        _add_text(layout, words, (box[0] + box[2] - 40, box[1] - _GAP_MM, 40.0, _GAP_MM), 7)


def _number(field: str, decimals: int) -> str:
    """An expression for a field's values with so many decimals; what they make zero has no sign."""
    return f'format_number(round("{field}", {decimals}) + 0, {decimals})'


def _in_words(field: str) -> str:
    """An expression for a field's values in the language of QGIS; the field itself where these are its own words."""
    words = {value: tr(value) for value in _VALUES.get(field, ())}
    if all(value == word for value, word in words.items()):
        return field
    cases = " ".join(f"WHEN \"{field}\" = '{value}' THEN '{word}'" for value, word in words.items())
    return f'CASE {cases} ELSE "{field}" END'


def _is_filled(zones: QgsVectorLayer, field: str) -> bool:
    """Whether any feature has a value there."""
    index = zones.fields().indexOf(field)
    return index >= 0 and any(value not in (None, "", NULL) for value in zones.uniqueValues(index))


def _add_block(layout: QgsPrintLayout, sheet: Sheet, box: Box) -> None:
    """Title, what it is, who made it, scale and reference system, in a frame."""
    left, top, width, height = box
    rectangle = QgsLayoutItemShape(layout)
    rectangle.setShapeType(QgsLayoutItemShape.Shape.Rectangle)
    line = QgsSimpleFillSymbolLayer(QColor(0, 0, 0, 0), Qt.BrushStyle.NoBrush, QColor("#444444"))
    line.setStrokeWidth(0.2)
    rectangle.setSymbol(QgsFillSymbol([line]))
    _place(layout, rectangle, box)
    half = width / 2
    _add_text(layout, literal(sheet.title), (left + 2, top + 1.5, half + 20, 9.0), 13, bold=True)
    _add_text(layout, literal(sheet.subtitle), (left + 2, top + 10.5, half + 20, 12.5), 8)
    scale = tr("Scale") + " 1 : [% round(item_variables('map')['map_scale']) %]"
    system = tr("Reference system") + ": [% @project_crs_description %] ([% @project_crs %])"
    author = literal(sheet.author)
    lines = [f"{tr('Made by')}: {author}" if author else "", scale, system, literal(sheet.source)]
    right = "\n".join(line for line in lines if line)
    _add_text(layout, right, (left + half + 24, top + 2, half - 26, height - 3), 8)


def literal(text: str) -> str:
    """``text`` so that a label shows it as it is: an expression or a date in it stays text."""
    return _EVALUATED.sub(lambda found: f"[% '{found[0][0]}' || '{found[0][1:]}' %]", text)


def _add_text(
    layout: QgsPrintLayout, text: str, box: Box, size: int, *, bold: bool = False, centred: bool = False
) -> None:
    item = QgsLayoutItemLabel(layout)
    item.setText(text)
    item.setTextFormat(_format(size, bold=bold))
    if centred:
        item.setHAlign(Qt.AlignmentFlag.AlignHCenter)
    item.setMarginX(0)
    item.setMarginY(0)
    _place(layout, item, box)


def _format(size: int, *, bold: bool = False) -> QgsTextFormat:
    found = QgsTextFormat()
    font = found.font()
    font.setBold(bold)
    found.setFont(font)
    found.setSize(size)
    found.setSizeUnit(QgsUnitTypes.RenderUnit.RenderPoints)
    found.setColor(QColor("#202020"))
    return found
