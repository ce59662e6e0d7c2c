"""The plugin in a QGIS whose language is Chinese: no dialog, menu or help is left in English."""

from __future__ import annotations

import re
from typing import Any

import pytest
from qgis.core import QgsApplication
from slopewatch.plugin.bridge import language, resources
from slopewatch.plugin.provider import SlopeWatchProvider
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.processing_algorithms.dialog_words import in_dialog_words

ENGLISH = re.compile(r"(?:\b[A-Za-z][a-z]+ ){3,}[a-z]+\b")
"""Four words in a row; names of software, units, values and files are left out by that."""
CHINESE = re.compile("[\u4e00-\u9fff]")


@pytest.fixture
def chinese(qgis_app: QgsApplication, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(language.QgsApplication, "locale", staticmethod(lambda: "zh_CN"))
    installed = language.install()
    yield
    language.remove(installed)


@pytest.mark.parametrize("kind", ALGORITHMS, ids=lambda kind: kind.NAME)
def test_a_dialog_is_chinese(chinese: None, kind: Any) -> None:
    algorithm = kind()
    algorithm.initAlgorithm()
    said = [algorithm.displayName(), algorithm.group(), algorithm.shortDescription(), algorithm.shortHelpString()]
    said += [text for p in algorithm.parameterDefinitions() for text in (p.description(), p.help())]
    said += [output.description() for output in algorithm.outputDefinitions()]
    for text in said:
        plain = re.sub(r"<[^>]*>", "", text)
        assert ENGLISH.findall(plain) == [], text
    assert all(CHINESE.search(text) for text in said[:4])
    labels = [p.description() for p in algorithm.parameterDefinitions()]
    assert [one for one in labels if not CHINESE.search(one)] == []


def test_every_tool_has_a_chinese_help_page_and_english_stays(chinese: None, monkeypatch: pytest.MonkeyPatch) -> None:
    for kind in ALGORITHMS:
        assert "/zh_CN/" in resources.help_url(kind.NAME), kind.NAME
    monkeypatch.setattr(language.QgsApplication, "locale", staticmethod(lambda: "de"))
    assert "/zh_CN/" not in resources.help_url("inspectslope")


def test_a_chinese_sentence_of_the_engine_names_the_dialogs_fields(chinese: None) -> None:
    kind = next(one for one in ALGORITHMS if one.NAME == "inspectslope")
    algorithm = kind()
    algorithm.initAlgorithm()
    label = algorithm.parameterDefinition("CRS").description()
    assert CHINESE.search(label)
    said = in_dialog_words(algorithm, kind.PARAMETER_GROUPS, "点云a.laz没有坐标参考系；请用--crs指定。")
    assert said == f"点云a.laz没有坐标参考系；请用“{label}”指定。"


def test_search_finds_a_tool_by_its_english_title_too(chinese: None) -> None:
    provider = SlopeWatchProvider()
    provider.loadAlgorithms()
    for algorithm in provider.algorithms():
        if type(algorithm) in ALGORITHMS:
            assert type(algorithm).TITLE in algorithm.tags()
