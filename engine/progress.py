"""Progress and messages of a running command: to a terminal, as JSON lines, or to nobody."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class Progress:
    """Receives progress; this base class drops it. Steps take one and never print themselves."""

    def __init__(self) -> None:
        self._low, self._high = 0.0, 100.0

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

    def emit(self, percent: float, message: str) -> None:
        """Overridden by what shows the progress."""

    def info(self, message: str) -> None:
        """A line worth reading later."""

    def warning(self, message: str) -> None:
        """Something the user should know; also kept in the run record."""
