"""Alert level of a zone after each survey: when it is reached, kept and withdrawn, and by which test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from .alerts import AlertLevel, Evidence, alert_of
from .inverse_velocity import failure_time
from .persistence import current_run, is_at_rest
from .tangent_angle import tangent_angle
from .velocity import current_velocity, zone_velocity
from .visits import visits

_MAX_CHANCE_OF_ANGLE = 0.25  # the largest that a table may ask for
STATES = ("", "reached", "kept", "withdrawn")
"""Of a level: none yet, reached by the survey, kept because too few quiet surveys followed, or fallen after them."""


@dataclass(frozen=True)
class Displacements:
    """Displacement of a zone by survey; arrays (n,).

    ``change`` and ``variance`` are as for ``velocity.zone_velocity``; ``confirmed``: which surveys confirm the zone;
    ``area`` that each measured, m²; 0 for motion along the surface, which moves no volume.
    """

    days: Float
    change: Float
    variance: Float
    confirmed: NDArray[np.bool_]
    area: Float
    along_surface: bool = False

    def evidence(self, survey: int, quiet: int) -> Evidence:
        """What was known after a survey; ``quiet`` as for ``is_at_rest``."""
        until = slice(0, survey + 1)
        days, change, variance = self.days[until], self.change[until], self.variance[until]
        measured = np.isfinite(change)
        run = current_run(self.confirmed[until][1:].tolist(), measured[1:].tolist())
        sign = -1.0 if change[-1] < 0 else 1.0
        before = int(np.flatnonzero(measured[:-1])[-1])  # the first survey measured it
        volume = max(sign * float(change[-1] - change[before]), 0.0) * float(self.area[survey])
        error = float(np.sqrt(variance[-1] + variance[before]) * self.area[survey])
        days, change, variance = visits(days, change, variance)
        velocity, failure = current_velocity(days, change, variance), failure_time(days, change, variance)
        away = velocity is not None and velocity.slope * sign > 0
        left = None
        if away and failure.earliest is not None and failure.latest is not None:
            left = failure.earliest - float(self.days[survey]), failure.latest - float(self.days[survey])
        angle = None
        if away and failure.chance < _MAX_CHANCE_OF_ANGLE:
            since = zone_velocity(days, change, variance)
            start = 0 if since is None or since.onset is None else since.onset[1]
            angle = tangent_angle(days, change, variance, start).degrees
        return Evidence(
            epochs_confirmed=run,
            change_sigmas=self._sigmas(survey, run),
            rate_mm_day=None if velocity is None else sign * 1000.0 * velocity.slope,
            rate_err=0.0 if velocity is None else 1000.0 * velocity.error,
            tangent_angle_deg=angle,
            failure_in_days=left,
            steady_chance=failure.chance,
            volume_m3=volume,
            volume_err=error,
            along_surface=self.along_surface,
            at_rest=is_at_rest(days, change, variance, quiet),
        )

    def _sigmas(self, survey: int, run: int) -> float:
        """Standard errors by which the mean change of the last ``run`` comparisons is beyond zero."""
        known = np.flatnonzero(np.isfinite(self.change[1 : survey + 1]))[-run:] + 1
        if not run or not len(known):
            return 0.0
        error = np.sqrt(self.variance[known].sum() / len(known) ** 2 + self.variance[0])
        return float(abs(self.change[known].mean()) / error)


@dataclass(frozen=True)
class LevelHistory:
    """Alert level after each survey (n,), its state (one of ``STATES``), and the reason of the level or of its fall."""

    levels: tuple[int, ...]
    states: tuple[str, ...]
    reasons: tuple[str, ...]


def level_history(zone: Displacements, table: tuple[AlertLevel, ...]) -> LevelHistory:
    """The level after each survey, as it was with the surveys until then.

    A level is reached at once. It falls where as many surveys in a row as the table says do not reach it, to the
    highest that they reach; and to 0 where the zone is at rest (see ``is_at_rest``). A survey that did not measure
    the zone changes nothing.
    """
    levels, states, reasons = [0], [""], [""]
    lower: list[int] = []  # what the last surveys in a row reached, each less than the level that is held
    for survey in range(1, len(zone.days)):
        held = table[levels[-1]]
        if not np.isfinite(zone.change[survey]):
            levels.append(held.level)
            states.append(states[-1])
            reasons.append(reasons[-1])
            continue
        evidence = zone.evidence(survey, max(held.quiet_surveys, 1))
        row, reason = alert_of(evidence, table)
        if states[-1] == "withdrawn" and not held.level and not _moves(evidence, row):
            row = held  # what came to rest needs new motion, not only the change of before
        lower = [] if row.level >= held.level else [*lower, row.level]
        state = "reached" if row.level else states[-1] and "withdrawn"
        if lower:
            row, state, reason = _after_less(held, lower, evidence, table, reasons[-1])
            lower = lower if state == "kept" else []
        elif not row.level:
            reason = reasons[-1]
        levels.append(row.level)
        states.append(state)
        reasons.append(reason)
    return LevelHistory(tuple(levels), tuple(states), tuple(reasons))


def _moves(evidence: Evidence, row: AlertLevel) -> bool:
    """Whether there is motion now, by its velocity or by a volume since the survey before."""
    rate = evidence.rate_mm_day or 0.0
    return rate > row.normal_quantile * evidence.rate_err or evidence.volume_m3 > (row.single_volume_m3 or np.inf)


def _after_less(
    held: AlertLevel, lower: Sequence[int], evidence: Evidence, table: tuple[AlertLevel, ...], before: str
) -> tuple[AlertLevel, str, str]:
    """Level, state and reason where the last surveys in a row reached less than the level that is held."""
    if evidence.at_rest and lower[-1] == 0:
        reason = f"level {held.level} withdrawn: no motion since {held.quiet_surveys} surveys or more"
        return table[0], "withdrawn", reason
    if len(lower) < held.quiet_surveys:
        return held, "kept", before
    row = table[max(lower[-held.quiet_surveys :])]
    return row, "withdrawn", f"level {held.level} withdrawn: the last {held.quiet_surveys} surveys do not reach it"
