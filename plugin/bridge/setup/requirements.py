"""The locks in the plugin's zip: each package with its version, its condition, and the SHA-256 of all its files."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ENGINE_LOCK = Path(__file__).with_name("engine.lock")
SCREENING_LOCK = Path(__file__).with_name("screening.lock")
INSTALLER = "pip"
OPTIONAL = frozenset(["numba", "llvmlite", "typst", "psycopg", "psycopg-binary"])
"""What the engine can do without where it has no ready build: slower, no PDF, no database."""
TORCH_CPU_INDEX = "https://download.pytorch.org/whl/cpu"
_ENTRY = re.compile(
    r"^([a-z0-9][a-z0-9._-]*)==([^\s;\\]+)[ ]*(?:;([^\\\n]*))?((?:\\?\n[ ]+--hash=sha256:[0-9a-f]{64} ?)+)", re.M
)


@dataclass(frozen=True)
class Requirement:
    """A package of a lock. ``marker`` says for which systems it is, "" for all; ``hashes`` are in hexadecimal."""

    name: str
    version: str
    marker: str
    hashes: frozenset[str]

    @property
    def text(self) -> str:
        """As pip reads it in a file of requirements; without the marker, which has been decided by then."""
        return " ".join([f"{self.name}=={self.version}", *(f"--hash=sha256:{one}" for one in sorted(self.hashes))])

    @property
    def title(self) -> str:
        return f"{self.name} {self.version}"

    @property
    def index(self) -> str:
        """The index that alone has it; "" for the usual one."""
        return TORCH_CPU_INDEX if self.version.endswith("+cpu") else ""


def read_lock(path: Path) -> list[Requirement]:
    """The entries of a lock, in its order.

    Raises:
        ValueError: a line of it is none of an entry.
    """
    text = re.sub(r"^#.*\n", "", path.read_text(encoding="utf-8"), flags=re.M)
    rest = _ENTRY.sub("", text).strip()
    if rest:
        raise ValueError(f"{path.name} has a line that is not understood: {rest.splitlines()[0]}")
    return [
        Requirement(name, version, marker.strip(), frozenset(re.findall(r"sha256:([0-9a-f]{64})", hashes)))
        for name, version, marker, hashes in _ENTRY.findall(text)
    ]
