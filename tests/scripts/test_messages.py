"""The catalogue translates everything that people are shown, and the tool that says so sees what is missing."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest
from slopewatch.interface.language import read_catalogue

SOURCE = '''
"""A docstring is no message."""
NAME = "slopewatch"
LABEL = "Zone"
def say(n, name):
    """Neither is this one."""
    raise InputError(f"{name} has {n:.1f} points of {{0}}; give another file.")
    path.write("a" + "two words")
'''


@pytest.fixture(scope="module")
def tool(root: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("messages", root / "scripts" / "messages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["messages"] = module
    spec.loader.exec_module(module)
    return module


def test_messages_are_sentences_and_not_docstrings(tool):
    sentences = ["{0} has {1} points of {{0}}; give another file.", "two words"]
    assert list(tool.messages_of(SOURCE)) == sentences
    assert set(tool.messages_of(SOURCE, labels=True)) == {*sentences, "Zone"}


def test_what_a_catalogue_lacks_is_named(tool):
    found = {"a b": ["x.py"], "c {0} d": ["x.py"], "e f": ["x.py"], "g h": ["x.py"]}
    have = {
        "a b": tool.Entry("a b", translation="甲"),
        "c {0} d": tool.Entry("c {0} d", translation="丙"),
        "e f": tool.Entry("e f"),
        "old one": tool.Entry("old one", not_shown=True),
    }
    said = "\n".join(tool.faults(found, have))
    assert "'a b'" not in said
    assert all(name in said for name in ("'c {0} d'", "'e f'", "'g h'", "'old one'"))


def test_a_catalogue_brought_up_to_date_keeps_its_translations(tool, tmp_path):
    old = {"a b": tool.Entry("a b", ["x.py"], "甲\n“乙”"), "gone away": tool.Entry("gone away", [], "去")}
    path = tmp_path / "x.po"
    path.write_text(tool.written(tool.updated({"a b": ["y.py"], 'new "one"': ["y.py"]}, old)), encoding="utf-8")
    again = tool.catalogue(path)
    assert list(again) == ["a b", 'new "one"']
    assert again["a b"].translation == "甲\n“乙”"
    assert again["a b"].places == ["y.py"]
    assert read_catalogue(path) == {"a b": "甲\n“乙”"}


def test_nothing_is_missing_in_the_catalogue(tool):
    assert tool.faults(tool.messages(), tool.catalogue()) == []
