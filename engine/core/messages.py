"""How files are named in messages, and what keeps these in one line."""

from __future__ import annotations

import re
from pathlib import Path

_MAX_VALUE_CHARACTERS = 80
_PART_FOLDER = re.compile(r"\.slopewatch-part-[^/\\\s]+[/\\]")
_PART_FILE = re.compile(r"\.([^/\\\n]+?)\.\d+\.part(\.\w+)")


def shown(path: Path | str) -> str:
    """The name for a message of one line: control characters escaped, in quotes."""
    return f"'{one_line(str(path))}'"


def of_final_files(text: str) -> str:
    """``text`` with the names of unfinished files and hidden folders replaced by those that the files will have."""
    return _PART_FILE.sub(r"\1\2", _PART_FOLDER.sub("", text))


def one_line(text: str) -> str:
    """``text`` with what does not print escaped: a name may hold line ends, and commands to the terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def quoted(value: object) -> str:
    """A value of a file for a message: as Python writes it, cut where it is longer than anyone reads."""
    text = repr(value)
    return text if len(text) <= _MAX_VALUE_CHARACTERS else f"{text[:_MAX_VALUE_CHARACTERS]}..."
