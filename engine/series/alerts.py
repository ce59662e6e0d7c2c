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

from scipy.special import ndtri

from ...interface.rates import rate_unit
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
    "chance_percent",
    "quiet_surveys",
    "action",
)
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
# Limits of a column that must not fall, or must not rise, from level to level: else a level could never be reached.
_RISING = ("epochs_confirmed", "rate_mm_day", "tangent_angle_deg", "single_volume_m3")
_FALLING = ("failure_within_days", "chance_percent")
DEFAULT_CHANCE_PERCENT, DEFAULT_QUIET_SURVEYS = 2.5, 2


@dataclass(frozen=True)
class AlertLevel:
    """One line of the table. A threshold that is None does not count.

    A zone reaches the level when at least ``epochs_confirmed`` comparisons in a row, up to the last, confirm it and one
    of the thresholds ``rate_mm_day`` (at least, in size), ``tangent_angle_deg`` (at least) and ``failure_within_days``
    (the whole interval of the failure at most so many days after the last survey) is reached, or none of the three is
    given. Without confirmation it reaches the level when the volume since the survey before is at least
    ``single_volume_m3``.

    ``chance_percent`` is the chance that errors alone pass a test: rate and volume must exceed their thresholds, and
    angle and failure need a motion that gets faster, beyond it. The level falls after ``quiet_surveys``
    surveys in a row that do not reach it.
    """

    level: int
    name: str
    colour: str
    epochs_confirmed: int | None
    rate_mm_day: float | None
    tangent_angle_deg: float | None
    failure_within_days: float | None
    single_volume_m3: float | None
    chance_percent: float
    quiet_surveys: int
    action: str

    @property
    def normal_quantile(self) -> float:
        """Standard errors that a figure must be beyond its threshold."""
        return float(-ndtri(self.chance_percent / 100.0))


@dataclass(frozen=True)
class Evidence:
    """What is known of a zone after a survey.

    ``epochs_moved``: of ``epochs_confirmed`` those that show motion since the zone was last at rest; None: all.
    ``change_sigmas``: standard errors by which their mean change is beyond zero, or beyond that at rest.
    ``rate_mm_day`` is its current velocity, positive away from the first survey, and ``rate_err`` the standard error;
    ``tangent_angle_deg`` and ``failure_in_days`` (the interval, from the last survey) are None where they cannot be
    computed, and ``steady_chance`` is the chance that a steady motion is surveyed like this.
    ``volume_m3`` is what it lost or gained since the survey before, further away from the first survey, and
    ``volume_err`` its standard error. ``along_surface``: all of it is of the motion along the surface, not of the
    heights. ``rest``: the first and the last survey of the rest after its motion, up to which it is judged.
    """

    epochs_confirmed: int
    change_sigmas: float = 0.0
    rate_mm_day: float | None = None
    rate_err: float = 0.0
    tangent_angle_deg: float | None = None
    failure_in_days: tuple[float, float] | None = None
    steady_chance: float = 1.0
    volume_m3: float = 0.0
    volume_err: float = 0.0
    along_surface: bool = False
    epochs_moved: int | None = None
    rest: tuple[int, int] | None = None


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
    chance = number("chance_percent", low=0.0001, high=25)
    quiet = number("quiet_surveys", low=1, high=99, whole=True)
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
        chance_percent=DEFAULT_CHANCE_PERCENT if chance is None else chance,
        quiet_surveys=DEFAULT_QUIET_SURVEYS if quiet is None else int(quiet),
        action=text_of(values["action"]),
    )


def _check_order(levels: list[AlertLevel], name: str) -> None:
    if len(levels) < 2 or [row.level for row in levels] != list(range(len(levels))):
        raise InputError(f"{name}: the levels must be 0, 1, 2 and so on, one a line, at least two.")
    if len({row.name for row in levels}) < len(levels):
        raise InputError(f"{name}: two levels have the same name; give each its own.")
    thresholds = (*_RISING, "failure_within_days")
    for column in (*thresholds, "chance_percent"):
        if column in thresholds and getattr(levels[0], column) is not None:
            raise InputError(f"{name}: level 0 has a {column}; leave it empty, because it is what all zones have.")
        given = [(row.level, getattr(row, column)) for row in levels if getattr(row, column) is not None]
        for (low, first), (high, second) in pairwise(given):
            if second > first if column in _FALLING else second < first:
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
    """By which test a zone reaches a level; empty where it does not."""
    beyond, volume = row.normal_quantile, evidence.volume_m3
    chance = f"{row.chance_percent:g} %"
    least = volume - beyond * evidence.volume_err
    if row.single_volume_m3 is not None and volume and least >= row.single_volume_m3:
        return (
            f"volume {volume:.1f} m³ since the survey before, beyond {row.single_volume_m3:g} "
            f"with an error chance of {chance}"
        )
    comparisons = (row.epochs_confirmed, row.rate_mm_day, row.tangent_angle_deg, row.failure_within_days)
    if all(limit is None for limit in comparisons) or evidence.epochs_confirmed < (row.epochs_confirmed or 1):
        return ""
    reason = ""
    rate, angle, left = evidence.rate_mm_day, evidence.tangent_angle_deg, evidence.failure_in_days
    faster = evidence.steady_chance <= row.chance_percent / 100.0
    steady = f"{100 * evidence.steady_chance:.2g} %"
    if row.failure_within_days is not None and left is not None and faster and left[1] <= row.failure_within_days:
        reason = (
            f"failure {left[0]:.0f} to {left[1]:.0f} days after the survey, within {row.failure_within_days:g}; "
            f"a steady motion looks so with a chance of {steady}"
        )
    elif row.tangent_angle_deg is not None and angle is not None and faster and angle >= row.tangent_angle_deg:
        reason = (
            f"tangent angle {angle:.0f} degrees, at least {row.tangent_angle_deg:g}; "
            f"a steady motion looks so with a chance of {steady}"
        )
    elif row.rate_mm_day is not None and rate is not None and rate - beyond * evidence.rate_err >= row.rate_mm_day:
        unit = rate_unit([row.rate_mm_day])
        shown, limit = f"{unit.days * rate:.3g}", f"{unit.days * row.rate_mm_day:.3g}"
        reason = f"rate {shown} {unit.name}, beyond {limit} with an error chance of {chance}"
    elif all(limit is None for limit in comparisons[1:]) and evidence.change_sigmas >= beyond:
        moved = evidence.epochs_confirmed if evidence.epochs_moved is None else evidence.epochs_moved
        if moved < (row.epochs_confirmed or 1):
            return ""
        reason = f"confirmed by {moved} comparisons, at least {row.epochs_confirmed}, with an error chance of {chance}"
        if evidence.rest is not None:
            reason = (
                f"confirmed by {moved} comparisons since the zone was at rest, at least {row.epochs_confirmed}, "
                f"with an error chance of {chance}"
            )
    return f"along the surface: {reason}" if reason and evidence.along_surface else reason
