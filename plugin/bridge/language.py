"""The language of QGIS's interface: the plugin's words, and what the engine is asked to speak."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication, QTranslator

from ...interface.language import language_of, translator
from .words import CONTEXT


def language() -> str:
    """The language that QGIS's locale asks for, of those that there are."""
    return language_of(QgsApplication.locale())


class CatalogueTranslator(QTranslator):
    """Answers Qt from the catalogue; what it does not know, and other programs' texts, are left to others."""

    def __init__(self, name: str, parent: Any = None) -> None:
        super().__init__(parent)
        self._translate = translator(name)

    def isEmpty(self) -> bool:
        return False

    def translate(self, context: str, source: str, disambiguation: str | None = None, n: int = -1) -> str | None:
        if context != CONTEXT:
            return None
        found = self._translate(source)
        return None if found == source else found


def install(name: str = "") -> CatalogueTranslator:
    """Have Qt ask the catalogue of a language, by default QGIS's; give the result to ``remove`` at the end."""
    made = CatalogueTranslator(name or language(), QCoreApplication.instance())
    QCoreApplication.installTranslator(made)
    return made


def remove(installed: CatalogueTranslator) -> None:
    QCoreApplication.removeTranslator(installed)
    installed.deleteLater()
