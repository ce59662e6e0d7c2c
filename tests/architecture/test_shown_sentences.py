"""What the plugin shows is looked up in QGIS's language: no text goes to a log, label or message without ``tr``."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

WORLD = ("plugin", "processing_algorithms")
SHOWN_BY = {
    "pushInfo", "pushWarning", "pushSuccess", "pushMessage", "reportError", "setProgressText", "createMessage",
    "setText", "setToolTip", "setTitle", "setWindowTitle", "setPlaceholderText", "setHeaderLabels", "addRow",
    "addAction", "addMenu", "addTab", "QLabel", "QPushButton", "QAction", "QCheckBox", "QGroupBox", "QMenu",
    "setDescription", "setHelp",
}  # fmt: skip
LOOKED_UP_BY = {"tr", "in_dialog_words", "translate"}
NAMES = {"SlopeWatch"}
_WORD = re.compile(r"[A-Za-z]{2,}")


def faults(source: str) -> Iterator[str]:
    """Texts of a module that are shown as they are, a line each."""
    for call in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)):
        if _name(call) in SHOWN_BY:
            for argument in call.args:
                for text in _texts(argument):
                    if _WORD.search(text) and text not in NAMES:
                        yield f"line {call.lineno}: {text!r}"


def _name(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _texts(node: ast.AST) -> Iterator[str]:
    """The texts of an expression that are not looked up; arguments of other calls are theirs."""
    if isinstance(node, ast.Call):
        if isinstance(node.func, ast.Attribute) and _name(node) not in LOOKED_UP_BY:
            yield from _texts(node.func.value)  # "text".join(...), "text".format(...)
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    for child in ast.iter_child_nodes(node):
        if not isinstance(node, (ast.Subscript, ast.Compare)):  # keys, and what is compared with
            yield from _texts(child)


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("feedback.pushInfo('The engine is ready.')", 1),
        ("feedback.pushInfo(tr('The engine is ready.'))", 0),
        ("feedback.pushInfo(tr(f'The engine is {how}.'))", 0),
        ("feedback.pushInfo(f'The engine is {how}')", 1),
        ("feedback.pushInfo(f'{name}: {value}')", 0),
        ("QLabel('Cloud' if one else tr('Clouds'))", 1),
        ("bar.createMessage('SlopeWatch', tr(words))", 0),
        ("label.setText('{} zones'.format(3))", 1),
        ("label.setText(words['some key'])", 0),
    ],
)
def test_what_counts_as_a_fault(source: str, count: int) -> None:
    assert len(list(faults(source))) == count


def test_nothing_is_shown_without_being_looked_up(root: Path) -> None:
    said = [
        f"{path.relative_to(root)}, {fault}"
        for package in WORLD
        for path in sorted((root / package).rglob("*.py"))
        for fault in faults(path.read_text(encoding="utf-8"))
    ]
    assert said == []
