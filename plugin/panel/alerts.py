"""The alert level of a zone of a series in the panel: state, reason and history, in the words of the report."""

from __future__ import annotations

import csv
import html
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qgis.PyQt.QtWidgets import QTextBrowser

from ...interface.alert_states import AlertState, LevelChange, level_changes
from ..bridge.words import tr
from .courses import TABLE

LEVELS = "alerts_used.csv"
"""The table of levels that a run was judged by, with their colours."""
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")


def level_colours(folder: Path | None) -> dict[int, str]:
    """Colours of the levels by the table of a run; none where there is no table that can be read."""
    found: dict[int, str] = {}
    if folder is None:
        return found
    try:
        with (folder / LEVELS).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                level, colour = row.get("level") or "", row.get("colour") or ""
                if level.isdecimal() and _COLOUR.fullmatch(colour):
                    found[int(level)] = colour
    except (OSError, UnicodeDecodeError, csv.Error):
        return {}
    return found


def history_of(folder: Path, zone: str) -> list[LevelChange]:
    """The surveys that changed the level of a zone or its state, by the run's own table.

    Raises:
        ValueError, OSError: the table cannot be read.
    """
    path = folder / TABLE
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.get("zone_id") == zone]
    return level_changes(sorted(rows, key=lambda row: row.get("epoch") or ""))


class AlertView(QTextBrowser):
    """The level of a zone and how it came about."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self.setFrameShape(QTextBrowser.Shape.NoFrame)

    def say(self, sentence: str) -> None:
        """Show a sentence instead."""
        self.setPlainText(sentence)

    def show_alert(self, alert: AlertState, colour: str, history: Sequence[LevelChange]) -> None:
        mark = f'<span style="color:{colour}">■</span> ' if colour else ""
        texts = [alert.reason_words(tr), tr("Action: {}.").format(tr(alert.action)) if alert.action else ""]
        parts = [f"<p>{mark}<b>{html.escape(alert.words(tr))}</b></p>"]
        parts += [f"<p>{html.escape(text)}</p>" for text in texts if text]
        if history:
            heads = (tr("Survey"), tr("Level"), tr("State"), tr("Reason"))
            rows = [(c.day, str(c.level), tr(c.state), tr(c.reason)) for c in history]
            cells = ["".join(f"<th align='left'>{html.escape(head)}</th>" for head in heads)]
            cells += ["".join(f"<td>{html.escape(value)}</td>" for value in row) for row in rows]
            parts.append(f"<p><b>{html.escape(tr('History of the alert level'))}</b></p>")
            parts.append("<table cellpadding='3'>" + "".join(f"<tr>{row}</tr>" for row in cells) + "</table>")
        self.setHtml("".join(parts))
