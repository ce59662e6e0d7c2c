"""The alert level of a zone of a series as people read it, for report, panel and corridor page alike."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, Callable

Say = Callable[[str], str]
"""Gives a text in the reader's language."""

_STATES = {
    "reached": "{0}, reached on {1}",
    "kept": "{0}, kept, reached on {1}",
    "withdrawn": "{0}, withdrawn on {1}",
}


@dataclass(frozen=True)
class AlertState:
    """Level of a zone, the survey ``since`` which it has that level, and the reason of the level or of its fall."""

    level: int
    name: str
    state: str
    since: str
    reason: str
    action: str

    def short(self, say: Say) -> str:
        """Level, name and state."""
        words = f"{self.level} {say(self.name)}".strip()
        return f"{words}, {say(self.state)}" if self.state else words

    def words(self, say: Say) -> str:
        """Level, name, state and day: ``0 no confirmed change, withdrawn on 2024-09-28``."""
        if self.state not in _STATES or not self.since:
            return self.short(say)
        return say(_STATES[self.state]).format(f"{self.level} {say(self.name)}".strip(), self.since)

    def reason_words(self, say: Say) -> str:
        """The reason with a capital; empty where nothing was ever reached."""
        reason = say(self.reason) if self.reason else ""
        return reason[:1].upper() + reason[1:]


@dataclass(frozen=True)
class LevelChange:
    """A survey after which a zone has another level or state than before; ``surveys`` that follow leave it so."""

    day: str
    level: int
    state: str
    reason: str


def alert_state(row: Mapping[str, Any]) -> AlertState | None:
    """The state that a row of the zones of a series, or of a corridor, holds; None for zones that have no level."""
    level = _number(row.get("alert_level"))
    if level is None:
        return None
    texts = (_text(row.get(name)) for name in ("alert", "alert_state", "alert_since", "alert_reason", "action"))
    return AlertState(int(level), *texts)


def level_changes(rows: Iterable[Mapping[str, Any]]) -> list[LevelChange]:
    """Of a zone's rows in ``series.csv``, in the order of their surveys, those that change its level or state."""
    found: list[LevelChange] = []
    before = 0, ""
    for row in rows:
        state = alert_state(row)
        if state is not None and (state.level, state.state) != before:
            before = state.level, state.state
            found.append(LevelChange(_text(row.get("epoch")), state.level, state.state, state.reason))
    return found


def _number(value: Any) -> float | None:
    """Of a table's cell, be it a number or the text of a CSV file."""
    try:
        number = float(value) if isinstance(value, (str, Real)) and not isinstance(value, bool) else math.nan
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _text(value: Any) -> str:
    return value.strip() if isinstance(value, str) else ""
