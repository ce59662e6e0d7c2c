"""Progress and messages of a running command: to a terminal, as JSON lines, or to nobody."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from .messages import of_final_files


class Progress:
    """Receives progress and messages; steps take one and never print themselves.

    This base class shows nothing but remembers the warnings. ``emit`` and ``show`` are overridden by what shows them.
    """

    def __init__(self) -> None:
        self._low, self._high = 0.0, 100.0
        self.warnings: list[str] = []

    def update(self, fraction: float, message: str = "") -> None:
        """``fraction`` of the current stage, 0 to 1, and what is being done."""
        fraction = min(1.0, max(0.0, fraction))
        self.emit(self._low + fraction * (self._high - self._low), message)

    @contextmanager
    def stage(self, start: float, end: float, message: str = "") -> Iterator[Progress]:
        """Within the block, fractions run from ``start`` to ``end`` (each 0 to 1) of the current stage."""
        low, high = self._low, self._high
        self._low, self._high = low + start * (high - low), low + end * (high - low)
        try:
            self.update(0.0, message)
            yield self
            self.update(1.0, message)
        finally:
            self._low, self._high = low, high

    def split(self, names: list[str]) -> list[Progress]:
        """One progress for each of several equal jobs that run at the same time within the current stage."""
        done = [0.0] * len(names)
        return [_Share(self, name, index, done) for index, name in enumerate(names)]

    def info(self, message: str) -> None:
        """A line worth reading later."""
        self.show("info", message)

    def warning(self, message: str) -> None:
        """Something the user should know; shown once and kept for the run record."""
        message = of_final_files(message)
        if message not in self.warnings:
            self.warnings.append(message)
            self.show("warning", message)

    def headline(self, message: str) -> None:
        """A warning that stands before all others."""
        known = len(self.warnings)
        self.warning(message)
        if len(self.warnings) > known:
            self.warnings.insert(0, self.warnings.pop())

    def emit(self, percent: float, message: str) -> None:
        """Show that ``percent`` of the whole command is done."""

    def show(self, level: str, message: str) -> None:
        """Show a message of level ``info`` or ``warning``."""


class _Share(Progress):
    """One of several jobs at the same time; its warnings are the parent's."""

    _lock = threading.Lock()

    def __init__(self, parent: Progress, name: str, index: int, done: list[float]) -> None:
        super().__init__()
        self._parent, self._name, self._index, self._done = parent, name, index, done
        self.warnings = parent.warnings

    def emit(self, percent: float, message: str) -> None:
        with self._lock:
            self._done[self._index] = percent
            self._parent.update(sum(self._done) / len(self._done) / 100.0, f"{self._name}: {message}")

    def show(self, level: str, message: str) -> None:
        self._parent.show(level, f"{self._name}: {message}")


class Renamed(Progress):
    """Passes everything on to another; in messages ``old`` stands as ``new``, as where a copy of a file is read."""

    def __init__(self, parent: Progress, old: str, new: str) -> None:
        super().__init__()
        self._parent, self._old, self._new = parent, old, new
        self.warnings = parent.warnings

    def emit(self, percent: float, message: str) -> None:
        self._parent.update(percent / 100.0, message)

    def info(self, message: str) -> None:
        self._parent.info(message.replace(self._old, self._new))

    def warning(self, message: str) -> None:
        self._parent.warning(message.replace(self._old, self._new))
