"""Ids of tasks: what a slope's results depend on, as a hash; the hashes of large files are kept with size and time."""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path
from typing import Any

from ...engine.core.checksums import sha256
from ...engine.core.errors import InputError
from ...engine.core.input_files import parts_of
from ...engine.core.json_values import plain
from ...engine.core.messages import shown
from ...engine.core.staged_outputs import atomic_output
from ...engine.core.version import VERSION

_FORMAT = 1  # of what the results of a slope are; another number makes all tasks new


class FileHashes:
    """SHA-256 of files, read again only where size or time of change differ from those kept in ``path``.

    A file that was changed with the same size and put back to the same time of change to the nanosecond is not seen.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[str, list[Any]] = {}
        self._new = False
        with contextlib.suppress(OSError, ValueError, RecursionError):
            document = json.loads(path.read_text(encoding="utf-8"))
            if isinstance(document, dict):
                self._known = {k: v for k, v in document.items() if isinstance(v, list) and len(v) == 3}

    def of(self, path: Path) -> str:
        """The hash of a file, or of all files of a folder such as a file geodatabase.

        Raises:
            InputError: it cannot be read.
        """
        try:
            files = parts_of(path)
            states = [p.stat() for p in files]
            stamp = [sum(s.st_size for s in states), max((s.st_mtime_ns for s in states), default=0)]
            kept = self._known.get(str(path))
            if kept is None or kept[:2] != stamp:
                self._known[str(path)] = kept = [*stamp, sha256(*files)]
                self._new = True
        except InputError:
            raise
        except OSError as error:
            raise InputError(f"{shown(path)} cannot be read ({error.strerror}); check its permissions.") from error
        return str(kept[2])

    def save(self) -> None:
        """Keep what was read for the next run."""
        if not self._new:
            return
        with atomic_output(self._path) as partial:
            partial.write_text(json.dumps(self._known, indent=0, sort_keys=True), encoding="utf-8")
        self._new = False


def task_id(command: str, epochs: list[tuple[str, str]], files: dict[str, str], settings: dict[str, Any]) -> str:
    """32 hexadecimal digits for a slope's results.

    Args:
        epochs: day and SHA-256 of each survey, the earliest first.
        files: SHA-256 of the other inputs by role.
        settings: every setting with its value.
    """
    parts = {"format": _FORMAT, "version": VERSION, "command": command, "epochs": epochs, "files": files}
    text = json.dumps(plain(parts | {"settings": settings}), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]
