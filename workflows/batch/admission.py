"""Which slopes may start: as long as the sum of what they are estimated to need fits into a budget of memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass
class Admission:
    """Holds the estimates (bytes) of what runs.

    What alone needs more than the budget runs alone: the estimate may be wrong, and the batch must come to an end.
    """

    budget: int
    slots: int
    held: dict[str, int] = field(default_factory=dict)

    def next(self, waiting: Mapping[str, int]) -> str | None:
        """The one of ``waiting`` (estimates by name) that needs most and fits; None if none may start now."""
        if len(self.held) >= self.slots:
            return None
        room = self.budget - sum(self.held.values())
        fitting = [name for name, need in waiting.items() if not self.held or need <= room]
        return max(fitting, key=lambda name: waiting[name], default=None)

    def take(self, name: str, need: int) -> None:
        self.held[name] = need

    def release(self, name: str) -> None:
        del self.held[name]
