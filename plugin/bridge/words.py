"""Words that people see, in the language of QGIS."""

from __future__ import annotations

from qgis.PyQt.QtCore import QCoreApplication

CONTEXT = "SlopeWatch"
"""Of all of the plugin's texts, for Qt."""


def tr(text: str) -> str:
    """``text`` in QGIS's language; itself where it is not translated."""
    return str(QCoreApplication.translate(CONTEXT, text)) if text else text
