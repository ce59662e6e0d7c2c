"""False-alarm rates and lead times of alert levels and of ways to foresee a failure, on series with known truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

import numpy as np

from ...engine.core.arrays import Float
from ...engine.series.alerts import AlertLevel, Evidence, read_alerts
from ...engine.series.inverse_velocity import EXPONENTS, MAX_CHANCE, failure_time
from ...engine.series.level_history import Displacements, LevelHistory, level_history
from .real_data import alarm_series
from .series_alert_cases import CHOSEN, KINDS, NEW, Case, cases
from .table import Row, counted, say

DRAWS, SHORT_DRAWS = 4, 40
"""Times that each series is surveyed; those of 4 to 8 surveys for the false-alarm rate."""
_SHORT = 8
HISTORY_STEPS_DAYS, HISTORY_DRAWS = (7.0, 14.0, 30.0), 30
_HISTORY_ERROR_M = 0.006
_STEADY = tuple(kind for kind in KINDS if kind.startswith(("still", "creep")))
_FAILING = tuple(kind for kind in KINDS if kind.startswith("failing"))
_EPISODES = ("seasonal creep", "step-like")
_YEAR_DAYS = 365.25


@dataclass(frozen=True)
class Judged:
    """A zone of a case with its ``history``, the failure's interval (n, 2) after each survey, NaN where none is, and
    what was ``known`` then.
    """

    case: Case
    zone: Displacements
    history: LevelHistory
    interval: Float
    known: dict[int, Evidence]

    @property
    def levels(self) -> Float:
        return np.array(self.history.levels)

    @property
    def years(self) -> float:
        return float(self.case.days[-1]) / _YEAR_DAYS

    @property
    def highest_reached(self) -> int:
        """How often level 4 was reached anew."""
        levels = self.levels
        return int(np.count_nonzero((levels[1:] == 4) & (levels[:-1] < 4)))


Forecast = Callable[[Displacements, int], tuple[float, float] | None]
"""Days from a survey until the failure, the earliest and the latest."""


def forecast(
    zone: Displacements, survey: int, exponents: tuple[float, float] = EXPONENTS
) -> tuple[float, float] | None:
    """By Voight's law with exponents of a range."""
    until = slice(0, survey + 1)
    found = failure_time(zone.days[until], zone.change[until], zone.variance[until], exponents)
    if found.earliest is None or found.latest is None:
        return None
    return found.earliest - float(zone.days[survey]), found.latest - float(zone.days[survey])


def confirmed_forecast(zone: Displacements, survey: int) -> tuple[float, float] | None:
    """Life expectancy: a forecast counts if that of the survey before agrees, so that what is left falls day by day."""
    now, before = forecast(zone, survey), forecast(zone, survey - 1) if survey > 1 else None
    if now is None or before is None:
        return None
    since = float(zone.days[survey] - zone.days[survey - 1])
    return now if before[0] - since <= now[1] and before[1] - since >= now[0] else None


def _only(table: Sequence[AlertLevel], *kept: str) -> tuple[AlertLevel, ...]:
    """The table without its thresholds but ``kept``."""
    names = {"rate_mm_day", "tangent_angle_deg", "failure_within_days", "single_volume_m3"} - set(kept)
    nothing: dict[str, Any] = dict.fromkeys(names)
    left = [replace(row, **nothing) for row in table]
    # a level without any threshold would be that of every confirmed zone
    none = [all(getattr(row, name) is None for name in kept) for row in left]
    return tuple(
        replace(row, single_volume_m3=1e9, epochs_confirmed=99) if gone and row.level > 1 else row
        for row, gone in zip(left, none, strict=True)
    )


METHODS: dict[str, tuple[str, Forecast | None]] = {
    "velocity": ("rate_mm_day", None),
    "tangent angle": ("tangent_angle_deg", None),
    "Fukuzono (exponent 2)": ("failure_within_days", partial(forecast, exponents=(2.0, 2.0))),
    "Voight (exponent 1.5 to 2.5)": ("failure_within_days", None),
    "Voight (exponent 1.7 to 2.2)": ("failure_within_days", partial(forecast, exponents=(1.7, 2.2))),
    "Voight (exponent 1.2 to 3)": ("failure_within_days", partial(forecast, exponents=(1.2, 3.0))),
    "life expectancy": ("failure_within_days", confirmed_forecast),
}


def rows() -> list[Row]:
    """Levels on each kind of series, the targets, and the methods side by side.

    Each figure is of series that nothing was chosen on, beside those that the rules were chosen on.
    """
    table = read_alerts(None)
    new, chosen = (_all_judged(table, sample) for sample in (NEW, CHOSEN))
    return [
        *_beside(*([_kind_row(kind, found) for kind, found in judged.items()] for judged in (new, chosen))),
        *_beside(_target_rows(table, new, NEW), _target_rows(table, chosen, CHOSEN)),
        *_beside(_method_rows(table, new), _method_rows(table, chosen)),
        *_history_rows(table),
    ]


def _all_judged(table: tuple[AlertLevel, ...], sample: int) -> dict[str, list[Judged]]:
    with ProcessPoolExecutor() as pool:
        return dict(zip(KINDS, pool.map(partial(_judged, table, sample), KINDS), strict=True))


def _judged(table: tuple[AlertLevel, ...], sample: int, kind: str) -> list[Judged]:
    own = cases((kind,), sample=sample)
    found = [judge(case, zone, table) for case in own for draw in range(DRAWS) for zone in case.surveyed(draw)]
    say(f"judged {kind}, sample {sample}")
    return found


def _beside(new: Sequence[Row], chosen: Sequence[Row]) -> list[Row]:
    """The rows of new series, with the figures of those that the rules were chosen on."""
    return [
        replace(
            row,
            value="; ".join(filter(None, (row.value, row.peer))),
            peer="chosen on: " + "; ".join(filter(None, (other.value, other.peer))),
        )
        for row, other in zip(new, chosen, strict=True)
    ]


@dataclass(frozen=True)
class _Known(Displacements):
    """Displacements that keep what is known after each survey, in ``known``; ``by`` another forecast of the failure.

    What is known does not depend on the table as long as its levels have one chance of error and quiet surveys alike.
    """

    known: dict[int, Evidence] = field(default_factory=dict)
    by: Forecast | None = None

    def evidence(self, survey: int, quiet: int, beyond: float, rest: tuple[int, int] | None = None) -> Evidence:
        if survey not in self.known:
            self.known[survey] = super().evidence(survey, quiet, beyond, rest)
        found = self.known[survey]
        if self.by is None:
            return found
        steady = found.steady_chance > MAX_CHANCE
        return replace(found, failure_in_days=None if steady else self.by(self, survey))


def judge(
    case: Case, zone: Displacements, table: tuple[AlertLevel, ...], *, by: Forecast | None = None,
    known: dict[int, Evidence] | None = None,
) -> Judged:  # fmt: skip
    """A zone with the levels after each survey.

    Args:
        by: another forecast than that of the engine.
        known: what is known after each survey, from an earlier judgement of the zone by another table.
    """
    values = {f.name: getattr(zone, f.name) for f in fields(Displacements)}
    kept = _Known(**values, known={} if known is None else known, by=by)
    history = level_history(kept, table)
    left = np.full((len(zone.days), 2), np.nan)
    for survey in kept.known:
        stated = kept.evidence(survey, 0, 0.0).failure_in_days
        left[survey] = (np.nan, np.nan) if stated is None else stated
    return Judged(case, zone, history, left + zone.days[:, None], kept.known)


def _kind_row(kind: str, found: Sequence[Judged]) -> Row:
    shares = [100 * np.mean([j.levels.max() >= least for j in found]) for least in (1, 2, 3, 4)]
    right = [bool((j.levels <= j.case.highest).all()) for j in found]
    return Row(
        f"{kind}: zones that ever reached level 1, 2, 3, 4",
        " / ".join(f"{s:.1f}" for s in shares) + " %",
        "",
        f"never above what is right: {counted(right)}",
    )


def _target_rows(table: tuple[AlertLevel, ...], judged: dict[str, list[Judged]], sample: int) -> list[Row]:
    with ProcessPoolExecutor() as pool:
        found = pool.map(partial(_short_alarms, table, sample), _STEADY)
        alarms = [alarm for alarms in found for alarm in alarms]
    grass = [bool(j.levels.max() >= 1) for j in judged["still, seasonal grass"]]
    failing = [j for kind in _FAILING for j in judged[kind]]
    hits = [bool(j.levels[-1] >= 3) for j in failing]
    leads = [float(j.case.failure - j.case.days[np.argmax(j.levels >= 3)]) for j in failing if j.levels[-1] >= 3]
    fallen = [bool((j.levels <= j.case.highest).all()) for k in ("fast, then stopped", "repaired") for j in judged[k]]
    result = [
        Row("levels 3 and 4 on still slopes and constant creep, 4 to 8 surveys", counted(alarms, 2), "<= 0.5 %", "",
            bool(np.mean(alarms) <= 0.005)),
        Row("zones of still slopes with seasonal grass, two years: alerts", counted(grass), "0", "", not any(grass)),
        Row("failures with level 3 or more at the last survey before", counted(hits), ">= 80 %",
            f"first {np.median(leads):.0f} days before the failure (median)", bool(np.mean(hits) >= 0.8)),
        _interval_row(failing),
        Row("stopped or repaired: level withdrawn after two quiet surveys", counted(fallen), ">= 95 %", "",
            bool(np.mean(fallen) >= 0.95)),
    ]  # fmt: skip
    for kind in _EPISODES:
        often = 10 * sum(j.highest_reached for j in judged[kind]) / sum(j.years for j in judged[kind])
        result.append(Row(f"{kind}: level 4 for each slope and decade", f"{often:.2f}", "<= 1", "", bool(often <= 1)))
    return result


def _short_alarms(table: tuple[AlertLevel, ...], sample: int, kind: str) -> list[bool]:
    """Whether zones of series of few surveys ever had level 3."""
    return [
        bool(judge(case, zone, table).levels.max() >= 3)
        for case in cases((kind,), sample=sample)
        if len(case.days) <= _SHORT
        for draw in range(SHORT_DRAWS if case.zones == 1 else SHORT_DRAWS // 10)
        for zone in case.surveyed(draw)
    ]


def _interval_row(failing: Sequence[Judged]) -> Row:
    stated = [(j, i) for j in failing for i in np.flatnonzero(np.isfinite(j.interval[:, 0]))]
    held = [bool(j.interval[i, 0] <= j.case.failure <= j.interval[i, 1]) for j, i in stated]
    width = np.median([j.interval[i, 1] - j.interval[i, 0] for j, i in stated]) if stated else np.nan
    return Row("failure intervals that hold the failure", counted(held), ">= 90 %", f"{width:.0f} days wide (median)",
               bool(held and np.mean(held) >= 0.9))  # fmt: skip


def _method_rows(table: tuple[AlertLevel, ...], judged: dict[str, list[Judged]]) -> list[Row]:
    """Each method alone decides on levels 3 and 4."""
    result = []
    for name, (column, by) in METHODS.items():
        say(f"judging by {name}")
        own, found = _only(table, column), {}
        for kind in (*_EPISODES, *_FAILING, *(k for k in KINDS if k.startswith("creep")), "fast, then stopped"):
            found[kind] = [judge(j.case, j.zone, own, by=by, known=j.known) for j in judged[kind]]
        failing = [j for kind in _FAILING for j in found[kind]]
        steady = [bool(j.levels.max() >= 3) for kind in found if kind.startswith("creep") for j in found[kind]]
        episodes = [j for kind in _EPISODES for j in found[kind]]
        often = 10 * sum(j.highest_reached for j in episodes) / sum(j.years for j in episodes)
        hits = [bool(j.levels[-1] >= 3) for j in failing]
        most = [bool(j.levels[-1] >= 4) for j in failing]
        others = [bool(j.levels.max() < 4) for kind in found if kind not in _FAILING for j in found[kind]]
        right = [_is_right(j) for j in failing]
        held = "" if column != "failure_within_days" else f"; intervals hold {_interval_row(failing).value}"
        result.append(
            Row(
                f"by {name}: judged right, failing and other series alike in weight",
                f"{50 * (np.mean(right) + np.mean(others)):.0f} %",
                "",
                f"level 3 before failure {100 * np.mean(hits):.0f} %, level 4 {100 * np.mean(most):.0f} %; "
                f"level 3 on creep {100 * np.mean(steady):.1f} %; level 4 of episodes {often:.2f} a decade{held}",
            )
        )
    return result


def _is_right(judged: Judged) -> bool:
    """Of a series that fails: level 3 at the last survey, and no interval then that misses the failure."""
    low, high = judged.interval[-1]
    return bool(judged.levels[-1] >= 3 and not (judged.case.failure < low or judged.case.failure > high))


def _history_rows(table: tuple[AlertLevel, ...]) -> list[Row]:
    """Published displacements until a failure, surveyed at even steps with errors of ``_HISTORY_ERROR_M``."""
    result = []
    for name, days, way in alarm_series():
        for every in HISTORY_STEPS_DAYS:
            found = [history_judged(days, way, every, draw, table) for draw in range(HISTORY_DRAWS)]
            hits = [bool(j.levels[-1] >= 3) for j in found]
            leads = [_lead(j, 3) for j in found if j.levels.max() >= 3]
            stated = [(j, i) for j in found for i in np.flatnonzero(np.isfinite(j.interval[:, 0]))]
            held = [bool(j.interval[i, 0] <= (j.case.failure or np.inf) <= j.interval[i, 1]) for j, i in stated]
            lead = f"first {np.median(leads):.0f} days before (median); " if leads else ""
            say(f"{name}, every {every:g} days, first drawing:{_survey_by_survey(found[0])}")
            result.append(
                Row(
                    f"published displacements {name}, surveyed every {every:g} days, {len(found)} drawings: "
                    "level 3 at the last survey before the failure",
                    counted(hits),
                    "",
                    f"{lead}intervals that hold the failure {counted(held)}; level 4 at the last survey "
                    f"{sum(bool(j.levels[-1] >= 4) for j in found)}; the first drawing:{_survey_by_survey(found[0])}",
                )
            )
    return result


def history_judged(days: Float, way: Float, every: float, draw: int, table: tuple[AlertLevel, ...]) -> Judged:
    """Displacements (m) on ``days`` surveyed every so many days, from a day drawn at random on."""
    rng = np.random.default_rng([11, int(every), draw])
    surveys = np.arange(rng.uniform(0, every), days[-1], every)
    n = len(surveys)
    case = Case("failing", 9000 + draw, surveys - surveys[0], -np.interp(surveys, days, way),
                np.full(n, _HISTORY_ERROR_M), np.full(n, 9), np.zeros(n), float(days[-1] - surveys[0]))  # fmt: skip
    return judge(case, case.surveyed(draw)[0], table)


def _lead(judged: Judged, level: int) -> float:
    """Days from the first survey with a level to the failure."""
    return float((judged.case.failure or np.nan) - judged.case.days[np.argmax(judged.levels >= level)])


def _survey_by_survey(judged: Judged) -> str:
    """Days before the failure, level, and days to the failure as stated, of each survey."""
    failure = judged.case.failure or np.nan
    words = []
    for day, level, (low, high) in zip(judged.case.days, judged.levels, judged.interval, strict=True):
        stated = f" ({low - day:.0f} to {high - day:.0f})" if np.isfinite(low) else ""
        words.append(f" {day - failure:.0f} d: {level:.0f}{stated}")
    return ",".join(words)
