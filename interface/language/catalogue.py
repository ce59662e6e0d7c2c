"""Catalogues of translated messages: gettext's PO format, read without being compiled first.

The Python inside QGIS has no library for it, and compiled catalogues are not kept in the repository. Format: GNU
gettext manual, "The Format of PO Files". Contexts and plural forms are not used.
"""

from __future__ import annotations

import ast
from pathlib import Path


class CatalogueError(ValueError):
    """A line of a catalogue that is not understood."""


def read_catalogue(path: Path) -> dict[str, str]:
    """Translations by message; messages without one, with a doubtful ("fuzzy") or an obsolete one are left out.

    Raises:
        CatalogueError: a line is no comment, keyword or string, or a string is not closed.
        OSError, UnicodeDecodeError: the file cannot be read.
    """
    found: dict[str, str] = {}
    for entry in _entries(path):
        if entry.message and entry.translation and not entry.doubtful:
            found[entry.message] = entry.translation
    return found


class _Entry:
    """One message: its parts grow line by line."""

    def __init__(self) -> None:
        self.message, self.translation, self.doubtful = "", "", False


def _entries(path: Path) -> list[_Entry]:
    entries = [_Entry()]
    part = ""
    for number, raw in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        line = raw.strip()
        if not line or line.startswith("#"):
            if part == "msgstr":
                entries.append(_Entry())
                part = ""
            if line.startswith("#,") and "fuzzy" in line:
                entries[-1].doubtful = True
            continue
        keyword, _, rest = line.partition(" ")
        if keyword in ("msgid", "msgstr"):
            if keyword == "msgid" and part == "msgstr":
                entries.append(_Entry())
            part, line = keyword, rest.strip()
        try:
            text = ast.literal_eval(line)
        except (SyntaxError, ValueError) as error:
            raise CatalogueError(f"{path.name}, line {number}: {line[:60]} is no string") from error
        if not part or not isinstance(text, str):
            raise CatalogueError(f"{path.name}, line {number}: a string belongs to no message")
        if part == "msgid":
            entries[-1].message += text
        else:
            entries[-1].translation += text
    return entries
