"""The sheet of a project: its legend stays within its column, its table says no negative zero."""

from __future__ import annotations

from typing import Any

import pytest
from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsExpression,
    QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsFeature,
    QgsGeometry,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsPrintLayout,
    QgsProject,
    QgsRectangle,
    QgsVectorLayer,
)
from slopewatch.plugin.bridge.legend_words import in_lines
from slopewatch.plugin.bridge.print_layout import LAYOUT, PAPERS, Sheet, _number, add_sheet

EXTENT = QgsRectangle(500000, 4000000, 500060, 4000040)


def sheet_of(*names: str, paper: str = "A4") -> tuple[QgsProject, QgsPrintLayout]:
    """Of a project with a layer a name, each with one feature on the map."""
    project = QgsProject()
    project.setCrs(QgsCoordinateReferenceSystem("EPSG:32651"))
    layers = []
    for name in names:
        layer = QgsVectorLayer("Polygon?crs=EPSG:32651", name, "memory")
        feature = QgsFeature()
        feature.setGeometry(QgsGeometry.fromRect(EXTENT))
        layer.dataProvider().addFeature(feature)
        layers.append(project.addMapLayer(layer))
    add_sheet(project, Sheet("title", "subtitle", "author", "source", paper), EXTENT, layers, None)
    return project, project.layoutManager().layoutByName(LAYOUT)


@pytest.mark.parametrize("paper", ["A4", "A3"])
@pytest.mark.parametrize("name", ["Velocity vectors along the surface of the slope (arrows: motion of 2000 days)",
                                  "沿坡面的速度矢量在整个边坡上按全部测量的回归" * 2, "Zones"])  # fmt: skip
def test_the_legend_stays_within_the_paper(qgis_app: Any, name: str, paper: str) -> None:
    project, layout = sheet_of(name, "Hazard zones", paper=paper)
    (legend,) = (item for item in layout.items() if isinstance(item, QgsLayoutItemLegend))
    legend.adjustBoxSize()
    right = legend.pos().x() + legend.rect().width()
    assert right <= PAPERS[paper][0] - 8.0
    project.clear()


@pytest.mark.parametrize(
    "text",
    [
        "[% 1 + 1 %]", "a [%@project_folder%] b", "[[% 1 %]]", "[%%]", "[% 'it''s' %] [% \"x\" %]", "[% unfinished",
        "50 %] of [it]", "$CURRENT_DATE", "$CURRENT_DATE(yyyy) [%\n1%]", "[%$CURRENT_DATE%]", "[", "%", "it's",
    ],
)  # fmt: skip
def test_what_people_write_into_the_title_block_stays_text(qgis_app: Any, text: str) -> None:
    project = QgsProject()
    project.setCrs(QgsCoordinateReferenceSystem("EPSG:32651"))
    layer = QgsVectorLayer("Polygon?crs=EPSG:32651", "z", "memory")
    add_sheet(project, Sheet(text, f"{text}\n{text}", text, text, "A4"), EXTENT, [layer], None)
    layout = project.layoutManager().layoutByName(LAYOUT)
    labels = [item.currentText() for item in layout.items() if isinstance(item, QgsLayoutItemLabel)]
    assert {text, f"{text}\n{text}"} <= set(labels)
    (made,) = (label for label in labels if label.startswith("Made by: "))
    assert made.startswith(f"Made by: {text}\n")
    assert made.endswith(f"\n{text}")
    assert "Scale 1 : [%" not in made
    project.clear()


def test_words_are_broken_where_they_do_not_fit_and_nothing_is_lost(qgis_app: Any) -> None:
    text = "0 mm/day (pale: within the cell's level of detection)"
    assert in_lines(text, 200.0, 7) == text
    lines = in_lines(text, 30.0, 7).split("\n")
    assert len(lines) > 1
    assert " ".join(lines) == text
    assert in_lines("测" * 40, 30.0, 7).replace("\n", "") == "测" * 40
    assert "\n" in in_lines("测" * 40, 30.0, 7)


def test_a_series_says_of_which_motion_its_rates_are(qgis_app: Any) -> None:
    fields = "field=zone_id:string&field=kind:string&field=rate_mm_day:double"
    layer = QgsVectorLayer(
        f"Polygon?crs=EPSG:32651&{fields}&field=motion_rate_mm_day:double&field=motion_rate_err:double", "z", "memory"
    )
    for values in (["S001", "subsidence", -4.1, None, None], ["S002", "sliding", -0.31, 1.24, 0.28]):
        feature = QgsFeature(layer.fields())
        feature.setAttributes(values)
        feature.setGeometry(QgsGeometry.fromRect(EXTENT))
        layer.dataProvider().addFeature(feature)
    assert columns_of(layer) == [
        "Zone", "Kind", "Rate of the heights (mm/day)", "Along the surface (mm/day)", "± (mm/day)",
    ]  # fmt: skip
    layer.dataProvider().deleteFeatures([2])
    assert columns_of(layer) == ["Zone", "Kind", "Rate (mm/day)"]


def columns_of(zones: QgsVectorLayer) -> list[str]:
    """Headings of a sheet's table of zones."""
    project = QgsProject()
    project.setCrs(QgsCoordinateReferenceSystem("EPSG:32651"))
    add_sheet(project, Sheet("title", "subtitle", "author", "source", "A4"), EXTENT, [zones], zones)
    (table,) = project.layoutManager().layoutByName(LAYOUT).multiFrames()
    return [column.heading() for column in table.columns()]


@pytest.mark.parametrize(("value", "shown"), [(-0.0004, "0.00"), (-0.016, "-0.02"), (1.005e3, "1,005.00")])
def test_what_is_rounded_to_zero_has_no_sign(qgis_app: Any, value: float, shown: str) -> None:
    layer = QgsVectorLayer("Point?crs=EPSG:32651&field=rate:double", "zones", "memory")
    feature = QgsFeature(layer.fields())
    feature.setAttributes([value])
    context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
    context.setFeature(feature)
    assert QgsExpression(_number("rate", 2)).evaluate(context) == shown
