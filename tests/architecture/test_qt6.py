"""The plugin is ready for Qt 6: enumerations are named with their class, and nothing is used that Qt 6 took away.

PyQt6 has no short names of enumerations (Qt.Horizontal), no ``exec_`` and no QVariant types; QGIS for Qt 6 offers its
own enumerations under Qgis or by both names. See "Plugin migration to be compatible with Qt5 and Qt6" of QGIS's wiki.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

WORLD = ("plugin", "processing_algorithms")
GONE = {"exec_", "print_", "QRegExp", "QDesktopWidget", "QMatrix"}
ENUMERATIONS = {"ItemDataRole", "ItemFlag", "SelectionFlag", "StandardButton"}
"""Classes of enumerators that may be kept under a name of one's own."""


def faults(source: str) -> Iterator[str]:
    """What PyQt6 would refuse in a module, a line each."""
    tree = ast.parse(source)
    classes = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("qgis.PyQt")
        for alias in node.names
    }
    scoped = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
            if any(name.split(".")[0] in ("PyQt5", "PyQt6", "sip") for name in names):
                yield f"line {node.lineno}: import Qt through qgis.PyQt"
        if not isinstance(node, ast.Attribute):
            continue
        if node.attr in GONE:
            yield f"line {node.lineno}: {node.attr} is no longer there"
        is_enumerator = isinstance(node.value, ast.Name) and node.value.id in classes and node.attr[:1].isupper()
        if is_enumerator and id(node) not in scoped and node.attr not in ENUMERATIONS:
            yield f"line {node.lineno}: {ast.unparse(node)} needs the name of its enumeration"


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("from qgis.PyQt.QtCore import Qt\nQt.Orientation.Horizontal", 0),
        ("from qgis.PyQt.QtCore import Qt\nQt.Horizontal", 1),
        ("from qgis.PyQt.QtCore import Qt\nrole = Qt.ItemDataRole", 0),
        ("from qgis.PyQt.QtWidgets import QDialog\nQDialog().exec_()", 1),
        ("from qgis.PyQt.QtWidgets import QDialog\nQDialog().exec()\nQDialog.tr('x')", 0),
        ("from PyQt5.QtCore import Qt", 1),
        ("from qgis.PyQt.QtCore import QVariant\nQVariant.String", 1),
    ],
)
def test_what_counts_as_a_fault(source, count):
    assert len(list(faults(source))) == count


def test_the_plugin_uses_nothing_that_qt_6_refuses(root: Path):
    said = [
        f"{path.relative_to(root)}, {fault}"
        for package in WORLD
        for path in sorted((root / package).rglob("*.py"))
        if path.name != "compat.py"  # where the two differ
        for fault in faults(path.read_text(encoding="utf-8"))
    ]
    assert said == []
