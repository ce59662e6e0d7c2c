"""What a loaded result shows of its style in a QGIS whose language is Chinese: legend, columns, choices."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from qgis.core import QgsApplication, QgsProject, QgsRasterLayer, QgsVectorLayer
from slopewatch.plugin.bridge import language
from slopewatch.plugin.bridge.styling import Appearance, StylePostProcessor
from slopewatch.plugin.bridge.translated_style import translate_style
from slopewatch.tests.builders.qgis import Recorder

ENGLISH = re.compile(r"[A-Za-z]{3,}")
CHINESE = re.compile("[\u4e00-\u9fff]")


@pytest.fixture
def chinese(qgis_app: QgsApplication, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(language.QgsApplication, "locale", staticmethod(lambda: "zh_CN"))
    installed = language.install()
    yield
    language.remove(installed)


def loaded(layer: QgsVectorLayer | QgsRasterLayer) -> QgsVectorLayer | QgsRasterLayer:
    """As Processing loads it."""

    class Context:
        def project(self) -> QgsProject:
            return QgsProject.instance()

    assert layer.isValid()
    StylePostProcessor.create(Appearance(1)).postProcessLayer(layer, Context(), Recorder())
    return layer


def ramp_labels(layer: QgsRasterLayer) -> list[str]:
    return [item.label for item in layer.renderer().shader().rasterShaderFunction().colorRampItemList()]


def test_zones_have_chinese_columns_legend_and_choices(chinese: None, results: Path) -> None:
    layer = loaded(QgsVectorLayer(f"{results / 'zones.gpkg'}|layername=zones", "zones", "ogr"))
    aliases = [field.alias() for field in layer.fields() if field.alias()]
    assert len(aliases) > 20
    assert [one for one in aliases if not CHINESE.search(one)] == []
    labels = [category.label() for category in layer.renderer().categories()]
    assert "隆起，高" in labels
    assert [one for one in labels if ENGLISH.search(one)] == []
    index = layer.fields().indexOf("review_status")
    choices = {label: value for one in layer.editorWidgetSetup(index).config()["map"] for label, value in one.items()}
    assert choices == {"未复核": "unreviewed", "已确认": "confirmed", "已否决": "rejected"}


def test_the_legend_of_a_change_is_chinese_and_its_colours_stay(chinese: None, results: Path) -> None:
    path = str(results / "elevation_change.tif")
    plain = QgsRasterLayer(path, "change")
    assert any("lowered" in one for one in ramp_labels(plain))
    layer = loaded(QgsRasterLayer(path, "change"))
    labels = ramp_labels(layer)
    assert sum("降低" in one for one in labels) == sum("lowered" in one for one in ramp_labels(plain))
    assert [one for one in labels if ENGLISH.search(one)] == []
    items, others = (one.renderer().shader().rasterShaderFunction().colorRampItemList() for one in (layer, plain))
    assert [(i.value, i.color.rgba()) for i in items] == [(i.value, i.color.rgba()) for i in others]


def test_in_english_a_style_stays_as_it_is(qgis_app: QgsApplication, results: Path) -> None:
    layer = QgsVectorLayer(f"{results / 'zones.gpkg'}|layername=zones", "zones", "ogr")
    before = [field.alias() for field in layer.fields()], [c.label() for c in layer.renderer().categories()]
    translate_style(layer)
    assert ([field.alias() for field in layer.fields()], [c.label() for c in layer.renderer().categories()]) == before
