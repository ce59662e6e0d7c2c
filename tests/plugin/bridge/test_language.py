"""The plugin's words in the language of QGIS, by Qt's own way of asking."""

from __future__ import annotations

import pytest
from qgis.PyQt.QtCore import QCoreApplication
from slopewatch.plugin.bridge import language
from slopewatch.plugin.bridge.words import tr


@pytest.fixture
def chinese():
    installed = language.install("zh_CN")
    yield
    language.remove(installed)


@pytest.mark.usefixtures("chinese")
def test_texts_of_the_plugin_are_chinese_and_others_are_left_alone():
    assert tr("Cell size") == "单元尺寸"
    assert tr("no such text") == "no such text"
    assert QCoreApplication.translate("QgsOther", "Cell size") == "Cell size"


def test_without_it_texts_stay_english():
    assert tr("Cell size") == "Cell size"
    assert language.language() == "en"
