"""Progress whose messages begin with a name."""

from __future__ import annotations

from .progress import Progress


class NamedProgress(Progress):
    """One survey's share of the progress; the run record's warnings begin with its name, as those shown do."""

    def __init__(self, share: Progress, name: str) -> None:
        super().__init__()
        self._share, self._name, self._doing = share, name, ""

    def warning(self, message: str) -> None:
        sentence = f"{self._name}: {message}"
        if sentence not in self._share.warnings:
            self._share.warnings.append(sentence)
            self._share.show("warning", message)

    def emit(self, percent: float, message: str) -> None:
        self._doing = message or self._doing
        self._share.update(percent / 100.0, self._doing or "reading")

    def show(self, level: str, message: str) -> None:
        self._share.show(level, message)
