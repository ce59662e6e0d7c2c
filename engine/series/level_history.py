"""Alert level of a zone after each survey: when it is reached, kept and withdrawn, and by which test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..statistics.normal import Z95
from .alerts import AlertLevel, Evidence, alert_of
from .inverse_velocity import failure_time
from .persistence import current_run, rest_since
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

    def evidence(self, survey: int, quiet: int, beyond: float, rest: tuple[int, int] | None = None) -> Evidence:
        """What was known after a survey.

        Args:
            quiet, beyond: as for ``rest_since``.
            rest: the first and the last survey of the latest rest before.
        """
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
            in_motion = zone_velocity(days, change, variance)
            start = 0 if in_motion is None or in_motion.onset is None else in_motion.onset[1]
            angle = tangent_angle(days, change, variance, start).degrees
        still = rest_since(days, change, variance, quiet, beyond)
        rest = rest if still is None else (still, survey)
        moved, sigmas = self._moved(survey, run, sign, rest)
        return Evidence(
            epochs_confirmed=run,
            epochs_moved=moved,
            change_sigmas=sigmas,
            rate_mm_day=None if velocity is None else sign * 1000.0 * velocity.slope,
            rate_err=0.0 if velocity is None else 1000.0 * velocity.error,
            tangent_angle_deg=angle,
            failure_in_days=left,
            steady_chance=failure.chance,
            volume_m3=volume,
            volume_err=error,
            along_surface=self.along_surface,
            rest=rest,
        )

    def _moved(self, survey: int, run: int, sign: float, rest: tuple[int, int] | None) -> tuple[int, float]:
        """Of the last ``run`` comparisons in a row those that show motion beyond a rest, or beyond the first survey,
        and the standard errors by which their mean is beyond it.
        """
        first, last = (0, 0) if rest is None else rest
        still = np.flatnonzero(np.isfinite(self.change[: last + 1]))
        still = still[still >= first]
        weight = 1.0 / self.variance[still]
        place, place_variance = float(np.average(self.change[still], weights=weight)), 1.0 / float(weight.sum())
        known = np.flatnonzero(np.isfinite(self.change[: survey + 1]))
        known = known[known > last]
        way = sign * (self.change[known] - place)
        beyond = way > Z95 * np.sqrt(self.variance[known] + place_variance)
        moved = min(run, current_run(beyond.tolist(), [True] * len(known))) if rest else run
        if not moved:
            return 0, 0.0
        error = np.sqrt(self.variance[known][-moved:].sum() / moved**2 + place_variance)
        return moved, float(abs(way[-moved:].mean()) / error)


@dataclass(frozen=True)
class LevelHistory:
    """Alert level after each survey (n,), its state (one of ``STATES``), and the reason of the level or of its fall."""

    levels: tuple[int, ...]
    states: tuple[str, ...]
    reasons: tuple[str, ...]


def level_history(zone: Displacements, table: tuple[AlertLevel, ...]) -> LevelHistory:
    """The level after each survey, as it was with the surveys until then.

    A level is reached at once. It falls where as many surveys in a row as the table says do not reach it, to the
    highest that they reach; and to 0 where the zone is at rest (see ``rest_since``). What was confirmed before the rest
    raises no level again. A survey that did not measure the zone changes nothing.
    """
    levels, states, reasons, rest = [0], [""], [""], None
    lower: list[int] = []  # what the last surveys in a row reached, each less than the level that is held
    why = ""  # the level that is held came about
    for survey in range(1, len(zone.days)):
        held = table[levels[-1]]
        if not np.isfinite(zone.change[survey]):
            levels.append(held.level)
            states.append(states[-1])
            reasons.append(reasons[-1])
            continue
        asked = table[max(held.level, 1)]
        evidence = zone.evidence(survey, asked.quiet_surveys, asked.normal_quantile, rest)
        rest = evidence.rest
        row, reason = alert_of(evidence, table)
        lower = [] if row.level >= held.level else [*lower, row.level]
        state = "reached" if row.level else states[-1] and "withdrawn"
        if lower:
            at_rest = rest is not None and rest[1] == survey
            row, state, reason = _after_less(held, lower, table, why, at_rest=at_rest)
            lower = lower if state == "kept" else []
        elif not row.level:
            reason = reasons[-1]
        levels.append(row.level)
        states.append(state)
        reasons.append(reason)
        why = why if state == "kept" else reason
    return LevelHistory(tuple(levels), tuple(states), tuple(reasons))


def _after_less(
    held: AlertLevel, lower: Sequence[int], table: tuple[AlertLevel, ...], why: str, *, at_rest: bool
) -> tuple[AlertLevel, str, str]:
    """Level, state and reason where the last surveys in a row reached less than the level that is held."""
    if at_rest and lower[-1] == 0:
        reason = f"level {held.level} withdrawn: no motion seen for {held.quiet_surveys} surveys or more"
        return table[0], "withdrawn", reason
    if len(lower) < held.quiet_surveys:
        return held, "kept", f"kept after {len(lower)} of {held.quiet_surveys} surveys below the level; before: {why}"
    row = table[max(lower[-held.quiet_surveys :])]
    return row, "withdrawn", f"level {held.level} withdrawn: the last {held.quiet_surveys} surveys do not reach it"
