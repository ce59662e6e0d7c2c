"""Buttons of the panel."""

from __future__ import annotations

from collections.abc import Callable

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtWidgets import QToolButton


def button(text: str, tip: str, slot: Callable[[], object], image: str = "", *, checkable: bool = False) -> QToolButton:
    """A button with words, with one of QGIS's own pictures before them where ``image`` names one."""
    made = QToolButton()
    made.setText(text)
    made.setToolTip(tip)
    made.setCheckable(checkable)
    if image:
        made.setIcon(QgsApplication.getThemeIcon(image))
        made.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
    made.clicked.connect(lambda *_: slot())
    return made
