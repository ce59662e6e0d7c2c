"""Folders of slopes: names that are safe on every system."""

from __future__ import annotations

import hashlib
import re

_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_LONGEST = 48  # letters: a result's path must fit where paths are short


def folder_name(slope: str) -> str:
    """A folder's name for a slope: its own where every system takes that, else a likeness with part of its hash."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", slope).strip("._-")[:_LONGEST]
    if plain == slope and not _RESERVED.fullmatch(plain):
        return plain
    return f"{plain or 'slope'}-{hashlib.sha256(slope.encode()).hexdigest()[:8]}"
