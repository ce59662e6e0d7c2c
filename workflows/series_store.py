"""What a series keeps from run to run, so that for a further survey only that one is computed.

Entries are files in the folder ``work`` of the outputs, named by a hash of all that they depend on, each with a JSON
file next to it that holds its checksum and its facts. Only damage can make an entry wrong, which the checksum shows;
the whole folder may be removed at any time.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.core.checksums import sha256
from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.staged_outputs import Stage
from ..engine.core.version import VERSION
from ..engine.grid.cell_statistics import CellStatistics
from ..engine.grid.kept_moments import KeptMoments

FOLDER = "work"
_FORMAT = 4  # of the entries; another number makes all of them new


@dataclass(frozen=True)
class Entry:
    """``path`` of the file for now; ``facts`` as they were given when it was made; ``reused`` from an earlier run."""

    path: Path
    facts: dict[str, Any]
    reused: bool


class Store:
    """The entries of one run: those of earlier runs in the output folder, new ones in its stage."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def entry(self, name: str, key: str, make: Callable[[Path], dict[str, Any]], progress: Progress) -> Entry:
        """The entry ``name`` (such as ``cells.npz``) for ``key``; ``make`` writes it and returns its facts.

        The facts' ``warnings`` are repeated when the entry is reused.
        """
        file, sidecar = (f"{FOLDER}/{name}" for name in names_of(name, key))
        known = _known(self._stage.final(file), self._stage.final(sidecar), progress)
        if known is not None:
            for sentence in known.get("warnings", ()):
                progress.warning(sentence)
            return Entry(self._stage.final(file), known, True)
        path = self._stage.path(file)
        facts: dict[str, Any] = plain(make(path))
        write_facts(self._stage.path(sidecar), sha256(path), facts)
        return Entry(path, facts, False)


def names_of(name: str, key: str) -> tuple[str, str]:
    """Names of an entry's file and of that with its facts, in ``FOLDER``."""
    return f"{key}_{name}", f"{key}_{name.partition('.')[0]}.facts.json"


def write_facts(path: Path, digest: str, facts: dict[str, Any]) -> None:
    """Write what is known of an entry, plain values, with the SHA-256 of its file."""
    text = json.dumps({"sha256": digest, "facts": facts}, indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", errors="backslashreplace")


def _known(file: Path, sidecar: Path, progress: Progress) -> dict[str, Any] | None:
    """The facts of an entry that is there and sound."""
    if not file.is_file() or not sidecar.is_file():
        return None
    try:
        document = json.loads(sidecar.read_text(encoding="utf-8"))
        if document["sha256"] == sha256(file):
            return dict(document["facts"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    progress.warning(f"{file.name} was damaged since it was kept and is made again.")
    return None


def key_of(**parts: Any) -> str:
    """16 hexadecimal digits that stand for all of ``parts`` (JSON values or dataclasses) and for this version."""
    text = json.dumps(plain({"format": _FORMAT, "version": VERSION, **parts}), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def save_cells(path: Path, cells: CellStatistics | KeptMoments) -> None:
    """Write what is kept of an epoch's cells as compressed NumPy arrays."""
    arrays = {f.name: getattr(cells, f.name) for f in fields(cells) if getattr(cells, f.name) is not None}
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_cells(path: Path) -> CellStatistics | KeptMoments:
    """What ``save_cells`` wrote.

    Raises:
        InputError: it is no such file.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            if "sums" in arrays:
                rows, columns = arrays["shape"].tolist()
                return KeptMoments(arrays["cell"], arrays["sums"], (rows, columns), float(arrays["level"]))
            wanted = [f.name for f in fields(CellStatistics) if f.name in arrays or f.default is MISSING]
            return CellStatistics(**{name: arrays[name] for name in wanted})
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path} cannot be read; remove the folder {path.parent} and run again.") from error
