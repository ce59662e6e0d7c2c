"""Icons and help pages that come with the plugin."""

from __future__ import annotations

import configparser
from pathlib import Path

from qgis.PyQt.QtCore import QUrl
from qgis.PyQt.QtGui import QIcon

from .language import language

_FOLDER = Path(__file__).resolve().parents[1]


def icon_path(name: str = "slopewatch") -> str:
    """The SVG called ``name``, or the plugin's own where there is none."""
    path = _FOLDER / "icons" / f"{name}.svg"
    return str(path if path.is_file() else _FOLDER / "icons" / "slopewatch.svg")


def icon(name: str = "slopewatch") -> QIcon:
    return QIcon(icon_path(name))


def version() -> str:
    """The plugin's version, from its metadata; empty if there is none."""
    manifest = configparser.ConfigParser(interpolation=None)
    manifest.read(_FOLDER.parent / "metadata.txt", encoding="utf-8")
    return manifest.get("general", "version", fallback="")


def help_text(name: str) -> str:
    """The help page ``name`` as HTML in one line: QGIS shows a line break as a new paragraph."""
    return " ".join(_help_page(name).read_text(encoding="utf-8").split())


def help_url(name: str) -> str:
    """Address of the help page ``name`` on this machine."""
    return QUrl.fromLocalFile(str(_help_page(name))).toString()


def _help_page(name: str) -> Path:
    """In the language of QGIS, where it has been translated."""
    page = _FOLDER / "help" / language() / f"{name}.html"
    return page if page.is_file() else _FOLDER / "help" / f"{name}.html"
