"""How files are named in messages."""

from __future__ import annotations

from pathlib import Path


def shown(path: Path | str) -> str:
    """The name for a message of one line: control characters escaped, in quotes."""
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(path))
    return f"'{text}'"
