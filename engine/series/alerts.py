"""Alert levels of zones from a table of thresholds that users can edit."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from ..core.errors import InputError
from ..core.messages import quoted, shown
from ..core.table_text import cell, text_of
from ..epochs.manifest import read_table

DEFAULT_TABLE = Path(__file__).with_name("alerts.csv")
COLUMNS = (
    "level",
    "name",
    "colour",
    "epochs_confirmed",
    "rate_mm_day",
    "tangent_angle_deg",
    "failure_within_days",
    "single_volume_m3",
    "action",
)
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
# Limits of a column that must not fall, or must not rise, from level to level: else a level could never be reached.
_RISING = ("epochs_confirmed", "rate_mm_day", "tangent_angle_deg", "single_volume_m3")


@dataclass(frozen=True)
class AlertLevel:
    """One line of the table. A threshold that is None does not count.

    A zone reaches the level when at least ``epochs_confirmed`` comparisons in a row confirm it and one of the
    thresholds ``rate_mm_day`` (at least, in size), ``tangent_angle_deg`` (at least) and ``failure_within_days`` (the
    earliest failure at most so many days after the last survey) is reached, or none of the three is given. Without
    confirmation it reaches the level when its volume is at least ``single_volume_m3``.
    """

    level: int
    name: str
    colour: str
    epochs_confirmed: int | None
    rate_mm_day: float | None
    tangent_angle_deg: float | None
    failure_within_days: float | None
    single_volume_m3: float | None
    action: str


@dataclass(frozen=True)
class Evidence:
    """What is known of a zone after the last survey.

    ``rate_mm_day`` is None unless its 95 % interval leaves out zero; ``tangent_angle_deg`` unless it can be computed
    and the last velocity is larger than the one before beyond chance; ``failure_in_days`` (from the last survey to
    the interval's earliest time) unless it can be computed. ``volume_m3`` is the net volume against the first survey, 0
    unless it is beyond its own level of detection. ``along_surface``: all of it is of the motion along the surface, not
    of the heights.
    """

    epochs_confirmed: int
    rate_mm_day: float | None
    tangent_angle_deg: float | None
    failure_in_days: float | None
    volume_m3: float
    along_surface: bool = False


def read_alerts(path: Path | None) -> tuple[AlertLevel, ...]:
    """The table of ``path``, or the one that comes with SlopeWatch; the lowest level, which has no thresholds, first.

    Raises:
        InputError: the file cannot be read, a column is missing or unknown, a value is no number or out of bounds, a
            level is missing or twice, or its thresholds are easier to reach than those of the level below.
    """
    path = path or DEFAULT_TABLE
    name = f"The alert table {shown(path)}"
    rows = read_table(path, "alert table")
    if not rows:
        raise InputError(f"{name} is empty; start from a copy of {DEFAULT_TABLE.name}.")
    head = [cell.strip().lower() for cell in rows[0][1]]
    for column in COLUMNS:
        if head.count(column) != 1:
            how = "is missing" if column not in head else "is there twice"
            raise InputError(f"{name}: the column {column} {how}; its columns are {', '.join(COLUMNS)}.")
    unknown = [column for column in head if column not in COLUMNS]
    if unknown:
        raise InputError(f"{name}: the column {quoted(unknown[0])} is not known; its columns are {', '.join(COLUMNS)}.")
    levels = []
    for number, cells in rows[1:]:
        if len(cells) != len(head):
            raise InputError(
                f"{name}: line {number} has {len(cells)} values instead of {len(head)}; quote texts with commas."
            )
        levels.append(_level(dict(zip(head, (c.strip() for c in cells), strict=True)), f"{name}: line {number}"))
    _check_order(levels, name)
    return tuple(levels)


def alerts_csv(levels: Sequence[AlertLevel]) -> str:
    """The table as CSV text that ``read_alerts`` reads."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in levels:
        values = (getattr(row, column) for column in COLUMNS)
        writer.writerow(
            [
                "" if v is None else f"{v:g}" if isinstance(v, float) else cell(v) if isinstance(v, str) else v
                for v in values
            ]
        )
    return text.getvalue()


def _level(values: dict[str, str], place: str) -> AlertLevel:
    def number(column: str, *, low: float = 0.0, high: float = math.inf, whole: bool = False) -> float | None:
        text = values[column]
        if not text:
            return None
        try:
            value = float(text)
            if not (math.isfinite(value) and low <= value <= high and (not whole or value == int(value))):
                raise ValueError
        except (ValueError, OverflowError):
            kind = "a whole number" if whole else "a number"
            bounds = f" from {low:g} to {high:g}" if high < math.inf else f" of at least {low:g}"
            raise InputError(f"{place}: {column} is {quoted(text)}; give {kind}{bounds}, or nothing.") from None
        return value

    level = number("level", high=99, whole=True)
    confirmed = number("epochs_confirmed", low=1, whole=True)
    if level is None:
        raise InputError(f"{place}: level is empty; give 0, 1, 2 and so on.")
    if not values["name"]:
        raise InputError(f"{place}: name is empty; give the level a name.")
    if not _COLOUR.fullmatch(values["colour"]):
        raise InputError(f"{place}: colour is {quoted(values['colour'])}; give it as #rrggbb.")
    return AlertLevel(
        level=int(level),
        name=text_of(values["name"]),
        colour=values["colour"].lower(),
        epochs_confirmed=None if confirmed is None else int(confirmed),
        rate_mm_day=number("rate_mm_day"),
        tangent_angle_deg=number("tangent_angle_deg", high=90),
        failure_within_days=number("failure_within_days"),
        single_volume_m3=number("single_volume_m3"),
        action=text_of(values["action"]),
    )


def _check_order(levels: list[AlertLevel], name: str) -> None:
    if len(levels) < 2 or [row.level for row in levels] != list(range(len(levels))):
        raise InputError(f"{name}: the levels must be 0, 1, 2 and so on, one a line, at least two.")
    if len({row.name for row in levels}) < len(levels):
        raise InputError(f"{name}: two levels have the same name; give each its own.")
    thresholds = (*_RISING, "failure_within_days")
    for column in thresholds:
        if getattr(levels[0], column) is not None:
            raise InputError(f"{name}: level 0 has a {column}; leave it empty, because it is what all zones have.")
        given = [(row.level, getattr(row, column)) for row in levels if getattr(row, column) is not None]
        for (low, first), (high, second) in pairwise(given):
            if second > first if column == "failure_within_days" else second < first:
                raise InputError(
                    f"{name}: {column} of level {high} ({second:g}) is easier to reach than that of level {low} "
                    f"({first:g}); correct one of them."
                )
    for row in levels[1:]:
        if all(getattr(row, column) is None for column in thresholds):
            raise InputError(f"{name}: level {row.level} has no threshold, so every zone would reach it; give one.")


def alert_of(evidence: Evidence, table: tuple[AlertLevel, ...]) -> tuple[AlertLevel, str]:
    """The highest level that a zone reaches, and by what."""
    for row in reversed(table[1:]):
        reason = _reached(evidence, row)
        if reason:
            return row, reason
    return table[0], ""


def _reached(evidence: Evidence, row: AlertLevel) -> str:
    volume = abs(evidence.volume_m3)
    if row.single_volume_m3 is not None and volume > 0 and volume >= row.single_volume_m3:
        return f"volume {volume:.1f} m³, at least {row.single_volume_m3:g}"
    comparisons = (row.epochs_confirmed, row.rate_mm_day, row.tangent_angle_deg, row.failure_within_days)
    if all(limit is None for limit in comparisons) or evidence.epochs_confirmed < (row.epochs_confirmed or 1):
        return ""
    rate, angle, left = evidence.rate_mm_day, evidence.tangent_angle_deg, evidence.failure_in_days
    along = evidence.along_surface
    if row.failure_within_days is not None and left is not None and left <= row.failure_within_days:
        most = f"{row.failure_within_days:g}"
        if along:
            return f"along the surface: failure possible from {left:.0f} days after the last survey, at most {most}"
        return f"failure possible from {left:.0f} days after the last survey, at most {most}"
    if row.tangent_angle_deg is not None and angle is not None and angle >= row.tangent_angle_deg:
        least = f"{row.tangent_angle_deg:g}"
        if along:
            return f"along the surface: tangent angle {angle:.0f} degrees, at least {least}"
        return f"tangent angle {angle:.0f} degrees, at least {least}"
    if row.rate_mm_day is not None and rate is not None and abs(rate) >= row.rate_mm_day:
        least = f"{row.rate_mm_day:g}"
        if along:
            return f"along the surface: rate {abs(rate):.2f} mm/day, at least {least}"
        return f"rate {abs(rate):.2f} mm/day, at least {least}"
    if all(limit is None for limit in comparisons[1:]):
        count = evidence.epochs_confirmed
        if along:
            return f"motion along the surface confirmed by {count} comparisons, at least {row.epochs_confirmed}"
        return f"confirmed by {count} comparisons, at least {row.epochs_confirmed}"
    return ""
