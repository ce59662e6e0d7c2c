"""Lists of the dialogs show their choices in QGIS's language; what they give the engine stays as it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from processing.core.Processing import Processing
from processing.gui import ParametersPanel
from processing.gui.AlgorithmDialog import AlgorithmDialog
from qgis.core import QgsProcessingContext, QgsProcessingParameterEnum, QgsProcessingProvider
from slopewatch.interface.choice_words import is_word, shown_choice
from slopewatch.plugin.bridge import language
from slopewatch.processing_algorithms import ALGORITHMS

CHINESE = re.compile("[\u4e00-\u9fff]")
WITH_LISTS = [
    kind for kind in ALGORITHMS if any(s.choices for group in kind.PARAMETER_GROUPS for s in group.specifications())
]


@pytest.fixture
def opened(provider: QgsProcessingProvider, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """Opens the dialog of an algorithm in a language."""
    monkeypatch.setattr(ParametersPanel, "iface", None)  # there is no main window
    Processing.initialize()
    dialogs: list[Any] = []
    installed: list[Any] = []

    def open_dialog(kind: Any, name: str) -> Any:
        monkeypatch.setattr(language.QgsApplication, "locale", staticmethod(lambda: name))
        installed.append(language.install())
        dialogs.append(AlgorithmDialog(kind().create()))
        return dialogs[-1]

    yield open_dialog
    for dialog in dialogs:
        dialog.close()
    for one in installed:
        language.remove(one)


def lists_of(dialog: Any) -> Iterator[tuple[Any, Any]]:
    """Wrapper and list of each choice."""
    for wrapper in dialog.mainWidget().wrappers.values():
        definition = wrapper.parameterDefinition()
        if isinstance(definition, QgsProcessingParameterEnum):
            yield wrapper, getattr(wrapper, "widget", None) or wrapper.wrappedWidget()


@pytest.mark.parametrize("kind", WITH_LISTS, ids=lambda kind: kind.NAME)
def test_choices_are_chinese_and_give_what_they_always_gave(opened: Callable[..., Any], kind: Any) -> None:
    context = QgsProcessingContext()
    seen = 0
    for wrapper, box in lists_of(opened(kind, "zh_CN")):
        options = wrapper.parameterDefinition().options()
        assert [box.itemData(n) for n in range(box.count())] == options
        for number, option in enumerate(options):
            text = box.itemText(number)
            assert bool(CHINESE.search(text)) == is_word(option), text
            assert option in text
            wrapper.setParameterValue(option, context)
            assert wrapper.parameterValue() == option
            seen += is_word(option)
    assert seen > 0 or kind.NAME in ("createproject",), "sheets of paper have no words"


def test_in_english_the_choices_are_those_of_settings_and_help(opened: Callable[..., Any]) -> None:
    kind = next(kind for kind in ALGORITHMS if kind.NAME == "inspectslope")
    for wrapper, box in lists_of(opened(kind, "en")):
        assert [box.itemText(n) for n in range(box.count())] == wrapper.parameterDefinition().options()


@pytest.mark.parametrize("choice", ["A4", "m", "km", "K12+345", "12+345"])
def test_units_papers_and_patterns_are_no_words(choice: str) -> None:
    assert shown_choice(choice, lambda message: f"({message})") == choice
