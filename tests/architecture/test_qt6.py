"""The plugin is ready for Qt 6: enumerations are named with their class, and nothing is used that Qt 6 took away.

PyQt6 has no short names of enumerations (Qt.Horizontal), no ``exec_`` and no QVariant types; QGIS for Qt 6 offers its
own enumerations under Qgis or by both names. See "Plugin migration to be compatible with Qt5 and Qt6" of QGIS's wiki.
The rules follow QGIS's own converter (scripts/pyqt5_to_pyqt6 of its sources) for Qt's classes, as far as they were
read, its fixes counted as faults; enumerations of QGIS's classes are not looked at. The plugin was not run with Qt 6.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

WORLD = ("plugin", "processing_algorithms")
GONE = {"exec_", "print_", "QRegExp", "QDesktopWidget", "QMatrix", "qApp", "resources_rc"}
RENAMED = {"MidButton", "TextColorRole", "BackgroundColorRole", "HighQualityAntialiasing"}
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
            if "qgis.PyQt.Qt" in names or GONE & {alias.name for alias in node.names}:
                yield f"line {node.lineno}: {ast.unparse(node)} is no longer there"
        if isinstance(node, ast.Call):
            yield from _calls(node)
        if isinstance(node, ast.Subscript) and ast.unparse(node).endswith(".activated[str]"):
            yield f"line {node.lineno}: activated[str] is textActivated"
        if not isinstance(node, ast.Attribute):
            continue
        if node.attr == "width" and "fontmetrics" in ast.unparse(node.value).lower():
            yield f"line {node.lineno}: the width of a text is horizontalAdvance"
        if node.attr in GONE | RENAMED:
            yield f"line {node.lineno}: {node.attr} is no longer there"
        is_enumerator = isinstance(node.value, ast.Name) and node.value.id in classes and node.attr[:1].isupper()
        if is_enumerator and id(node) not in scoped and node.attr not in ENUMERATIONS:
            yield f"line {node.lineno}: {ast.unparse(node)} needs the name of its enumeration"


def _calls(node: ast.Call) -> Iterator[str]:
    """Calls that PyQt6 takes with other arguments only."""
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    first = ast.unparse(node.args[0]) if node.args else ""
    if name == "addAction" and len(node.args) >= 4:
        yield f"line {node.lineno}: addAction takes an action"
    if name == "desktop" and not node.args:
        yield f"line {node.lineno}: desktop() is no longer there"
    if name == "QVariant" and (not node.args or first.startswith("QVariant")):
        yield f"line {node.lineno}: a null value is NULL of qgis.core"
    if name == "QDateTime" and (len(node.args) == 8 or (len(node.args) == 1 and first.startswith("QDate("))):
        yield f"line {node.lineno}: QDateTime takes a day and a time"


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
        ("from qgis.PyQt.Qt import Qt", 1),
        ("from qgis.PyQt.QtWidgets import qApp", 1),
        ("from . import resources_rc", 1),
        ("menu.addAction(icon, 'x', self.run, 'Ctrl+X')\nmenu.addAction(action)", 1),
        ("QVariant()\nQVariant(QVariant.Int)\nQVariant(3)", 2),
        ("QDateTime(QDate(2024, 5, 1))\nQDateTime(2024, 5, 1, 0, 0, 0, 0, 0)\nQDateTime(day, time)", 2),
        ("box.activated[str].connect(f)\nbox.activated.connect(f)", 1),
        ("painter.fontMetrics().width('x')\npainter.fontMetrics().horizontalAdvance('x')", 1),
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
