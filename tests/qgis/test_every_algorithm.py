"""What every algorithm of the provider must have: help, words and picture, a run of qgis_process and one of its dialog.

The table is the provider itself, so that an algorithm that is added without one of these fails here.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsApplication
from slopewatch.plugin.bridge import language, resources
from slopewatch.plugin.provider import SlopeWatchProvider
from slopewatch.plugin.shipped_model import TITLES as MODELS
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.tests.builders.algorithm_runs import RUNS

NAMES = [*(algorithm.NAME for algorithm in ALGORITHMS), *MODELS]
HERE = Path(__file__).resolve().parent
BASE = HERE.parent / "builders" / "qgis.py"
"""Fixtures that run algorithms for the tests of this folder."""
ENGLISH = re.compile(r"(?:\b[A-Za-z][a-z]+ ){3,}[a-z]+\b")
"""Four words in a row; names of software, units, values and files are left out by that."""
CHINESE = re.compile("[\u4e00-\u9fff]")
SYMBOLS = {"Hz", "m/s", "min", "s", "m", "m²", "mm/d", "GB", "px", "XLSX", "CSV"}
LEAST_HELP, LEAST_TAGS = 200, 6


@pytest.fixture(params=["en", "zh-Hans"])
def reader(request: pytest.FixtureRequest, qgis_app: QgsApplication, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The language of QGIS, by its name there."""
    monkeypatch.setattr(language.QgsApplication, "locale", staticmethod(lambda: request.param))
    installed = language.install()
    yield request.param
    language.remove(installed)


@pytest.fixture
def algorithm(provider: Any, name: str) -> Any:
    """As the toolbox makes it for a dialog."""
    return provider.algorithm(name).create()


def texts(algorithm: Any) -> list[str]:
    """All that a dialog shows, without tags of HTML."""
    said = [algorithm.displayName(), algorithm.group(), algorithm.shortDescription(), algorithm.shortHelpString()]
    definitions = algorithm.parameterDefinitions()
    said += [text for one in definitions for text in (one.description(), one.help())]
    said += [one.metadata().get("slopewatch_group") or "" for one in definitions]
    said += [output.description() for output in algorithm.outputDefinitions()]
    return [re.sub(r"<[^>]*>", "", text) for text in said]


def test_the_table_is_the_provider(provider: Any) -> None:
    assert sorted(NAMES) == sorted(algorithm.name() for algorithm in provider.algorithms())


@pytest.mark.parametrize("name", NAMES)
def test_help_and_words_are_in_the_readers_language(reader: str, algorithm: Any, name: str) -> None:
    title, group, summary, page = texts(algorithm)[:4]
    assert len(page) >= (LEAST_HELP if reader == "en" else LEAST_HELP // 4)
    pages = Path(resources.help_url("index").removeprefix("file://"))
    assert f'<h2 id="{name}">{title}</h2>' in pages.read_text(encoding="utf-8")
    assert ("zh_CN" in pages.parts) == (reader != "en")
    assert algorithm.helpUrl().endswith(f"#{name}")
    if reader == "en":
        assert [text for text in texts(algorithm) if CHINESE.search(text)] == []
        assert summary.endswith(".")
        return
    assert all(CHINESE.search(text) for text in (title, group, summary, page))
    assert [text for text in texts(algorithm) if ENGLISH.search(text)] == []
    labels = [one.description() for one in algorithm.parameterDefinitions()]
    assert [label for label in labels if not CHINESE.search(label)] == []
    units = {unit for label in labels for unit in re.findall(r" \(([^()]+)\)$", label)}
    assert {unit for unit in units if not CHINESE.search(unit)} <= SYMBOLS
    boxes = {one.metadata().get("slopewatch_group") or "" for one in algorithm.parameterDefinitions()}
    assert {box for box in boxes if box and not CHINESE.search(box)} == set()


@pytest.mark.parametrize("name", NAMES)
def test_an_algorithm_has_a_picture_of_its_own_and_tags(algorithm: Any, name: str) -> None:
    assert Path(algorithm.svgIconPath()).name == f"{name}.svg"
    image = algorithm.icon().pixmap(24, 24).toImage()
    assert len({image.pixel(x, y) for x in range(24) for y in range(24)}) > 3
    assert len(set(algorithm.tags())) >= LEAST_TAGS


def test_no_two_algorithms_have_the_same_picture(provider: Any) -> None:
    pictures = [Path(algorithm.svgIconPath()).read_bytes() for algorithm in provider.algorithms()]
    assert len(set(pictures)) == len(pictures)


@pytest.mark.parametrize("name", NAMES)
def test_every_field_says_what_it_does_and_at_most_ten_are_shown_at_first(algorithm: Any, name: str) -> None:
    definitions = algorithm.parameterDefinitions()
    assert [one.name() for one in definitions if not one.help()] == []
    hidden = definitions[0].Flag.FlagAdvanced if definitions else 0
    assert len([one for one in definitions if not one.isDestination() and not one.flags() & hidden]) <= 10


def runs_of_qgis_process(source: str) -> set[str]:
    """Names of the algorithms that a module has qgis_process run to their end.

    That is ``qgis_process.run(NAME, ...)``, also of another name of it, or its plain call with ``slopewatch:NAME``.
    """
    found = set()
    for call in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)):
        words = [one.value for one in call.args if isinstance(one, ast.Constant) and isinstance(one.value, str)]
        if isinstance(call.func, ast.Attribute) and call.func.attr == "run" and words:
            found.add(words[0])
        if isinstance(call.func, ast.Name) and call.func.id == "qgis_process" and "run" in words:
            found |= {word.partition(":")[2] for word in words if word.startswith("slopewatch:")}
    return found


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("qgis_process.run('topview', INPUT=a)", {"topview"}),
        ("qgis_process('--json', 'run', 'slopewatch:trainmodel')", {"trainmodel"}),
        ("qgis_process.attempt('topview', INPUT=a)\nqgis_process('help', 'slopewatch:topview')", set()),
    ],
)
def test_what_counts_as_a_run(source: str, names: set[str]) -> None:
    assert runs_of_qgis_process(source) == names


def test_every_algorithm_is_run_through_qgis_process() -> None:
    sources = [path.read_text(encoding="utf-8") for path in (*HERE.glob("test_*_process.py"), BASE)]
    assert set(NAMES) - set().union(*map(runs_of_qgis_process, sources)) == set()


def test_every_algorithm_is_run_from_its_dialog() -> None:
    """tests/qgis/test_every_dialog.py does what is here, and fails where something is missing, too."""
    assert {name.partition(":")[2] for name in RUNS} == set(NAMES)


def test_the_provider_makes_them_in_the_language_that_it_finds(reader: str, provider: Any) -> None:
    fresh = SlopeWatchProvider()
    fresh.loadAlgorithms()
    said = [algorithm.displayName() for algorithm in fresh.algorithms()]
    assert len(said) == len(NAMES)
    assert all(bool(CHINESE.search(title)) == (reader != "en") for title in said), said
