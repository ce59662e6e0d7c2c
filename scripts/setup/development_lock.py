"""Print the part of requirements.lock that tests and lint need in addition to the engine's packages, for pip.

python scripts/setup/development_lock.py > development.txt
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
PLUGIN_LOCKS = FOLDER.parents[1] / "plugin" / "bridge" / "setup"
LEFT_OUT = {"pycsw", "pytest-qgis", "pyarrow"}
SHARED = {"typing-extensions", "filelock", "setuptools"}
"""With the screening's network."""


def entries(path: Path) -> dict[str, str]:
    """Text of a lock's entries by their first line, such as ``numpy==2.2.6 ; python_full_version < '3.11'``."""
    found = re.findall(r"^[a-z0-9][^\n]*(?:\n[ ]+[^\n]*)*\n", path.read_text(encoding="utf-8"), flags=re.M)
    return {entry.splitlines()[0]: entry for entry in found}


def needed() -> dict[str, str]:
    """The entries by their first line."""
    known = entries(PLUGIN_LOCKS / "engine.lock")
    network = {line.partition("==")[0] for line in entries(PLUGIN_LOCKS / "screening.lock")} - SHARED
    return {
        line: entry
        for line, entry in entries(FOLDER / "requirements.lock").items()
        if line not in known and line.partition("==")[0] not in LEFT_OUT | network
    }


if __name__ == "__main__":
    sys.stdout.write("".join(needed().values()))
