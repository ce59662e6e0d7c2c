"""What is known of each slope, in a file of JSON lines: the last line of a slope counts."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import IO, Any

from ...engine.core.errors import InputError
from ...engine.core.staged_outputs import atomic_output

PENDING, RUNNING, DONE, FAILED = "pending", "running", "done", "failed"
STATES = (PENDING, RUNNING, DONE, FAILED)


@dataclass(frozen=True)
class Entry:
    """The state of one slope. ``sentence`` says why it failed; ``memory`` is what it was estimated to need, bytes."""

    slope: str
    task: str
    state: str = PENDING
    attempts: int = 0
    sentence: str = ""
    seconds: float = 0.0
    memory: int = 0


class StateFile:
    """The states of all slopes. Each change is one line, written and flushed to the disk before it counts.

    A line that a crash cut short is left out when the file is read; a slope that was at work is pending again.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: IO[str] | None = None
        self.entries: dict[str, Entry] = {}
        for entry in _read(path):
            self.entries[entry.slope] = entry
        for name, entry in self.entries.items():
            if entry.state == RUNNING:
                self.entries[name] = replace(entry, state=PENDING)

    @contextmanager
    def open(self, slopes: Iterable[str]) -> Iterator[StateFile]:
        """Write anew what is known of ``slopes``, and take changes until the block is left.

        Raises:
            InputError: it cannot be written.
        """
        wanted = set(slopes)
        self.entries = {name: entry for name, entry in self.entries.items() if name in wanted}
        with atomic_output(self._path) as partial:
            lines = [_line(entry) for entry in self.entries.values()]
            partial.write_text("".join(lines) or "\n", encoding="utf-8")
        with self._path.open("a", encoding="utf-8") as self._file:
            yield self
        self._file = None

    def put(self, entry: Entry) -> None:
        """Keep the state of a slope.

        Raises:
            InputError: the disk is full.
        """
        self.entries[entry.slope] = entry
        if self._file is None:
            return
        try:
            self._file.write(_line(entry))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise InputError(f"{self._path} cannot be written ({error.strerror}); free some space.") from error


def _line(entry: Entry) -> str:
    return json.dumps(asdict(entry), ensure_ascii=True) + "\n"


def _read(path: Path) -> Iterator[Entry]:
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check its permissions.") from error
    kinds = {f.name: type(f.default) for f in fields(Entry) if f.name not in ("slope", "task")}
    for line in text.splitlines():
        entry = _entry(line, kinds)
        if entry is not None:
            yield entry


def _entry(line: str, kinds: dict[str, type]) -> Entry | None:
    try:
        values: dict[str, Any] = json.loads(line)
        entry = Entry(str(values["slope"]), str(values["task"]), **{n: kind(values[n]) for n, kind in kinds.items()})
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    return entry if entry.state in STATES else None
