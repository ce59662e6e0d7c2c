"""Checksums of files."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ...interface.input_files import PART
from .input_files import open_input


def sha256(*paths: Path) -> str:
    """SHA-256 of the bytes of a file, or of several one after the other, hexadecimal.

    Raises:
        InputError: one is missing or no regular file, or cannot be opened.
    """
    digest = hashlib.sha256()
    for path in paths:
        with open_input(path, PART) as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
