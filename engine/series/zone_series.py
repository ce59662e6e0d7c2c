"""Time series of the zones of a series: their mean change survey by survey, with errors, velocity and alert level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..statistics.normal import Z95
from ..zones.fields import KINDS, SLIDING
from .alerts import AlertLevel
from .inverse_velocity import MAX_CHANCE, FailureTime, failure_time
from .level_history import LevelHistory
from .motion.zones import MovingGround
from .persistence import current_run
from .tangent_angle import LEVELS as TANGENT_LEVELS
from .tangent_angle import TangentAngle, tangent_angle
from .tracking import Track
from .velocity import Velocity, zone_velocity
from .visits import visits
from .zone_means import ZoneMeans


@dataclass(frozen=True)
class Stack:
    """The cells of all surveys against the first, on one grid. Lists have one entry a survey, the first included.

    Attributes:
        days: (n,) days since the first survey.
        change: (rows, columns) metres against the first survey; 0 in its own cells, NaN where not measured.
        variance: (rows, columns) each survey's own variance of a cell, plants included, m².
    """

    days: Float
    change: Sequence[Float]
    variance: Sequence[Float]


FOUND_BY = ("heights", "motion", "both")
"""What shows a zone: its heights, its motion along the surface, or both."""


@dataclass(frozen=True)
class Course:
    """What a zone's displacements say: its velocity, whether it gets faster, and when that would end."""

    velocity: Velocity | None
    angle: TangentAngle
    failure: FailureTime

    @classmethod
    def of(cls, days: Float, change: Float, variance: Float) -> Course:
        """From displacements (n,) and their own variances, as for ``zone_velocity``; see ``visits``."""
        days, change, variance = visits(days, change, variance)
        velocity = zone_velocity(days, change, variance)
        start = 0 if velocity is None or velocity.onset is None else velocity.onset[1]
        failure, angle = failure_time(days, change, variance), tangent_angle(days, change, variance, start)
        if angle.level and failure.chance > MAX_CHANCE:
            angle = replace(angle, level=TANGENT_LEVELS[0])  # not faster than a steady motion may look
        return cls(velocity, angle, failure)


@dataclass(frozen=True)
class SurfaceMotion:
    """The motion of a zone along the surface: of which ``ground``, its ``course``, and ``confirmed`` (n,) by which
    surveys; ``heights_confirmed`` by which surveys the heights do. ``leads``: its course, not that of the heights,
    decides the zone's alert.

    ``cells`` (flat indices in the grid of the changes) are those of the ground that moves.
    """

    ground: MovingGround
    cells: Index
    course: Course
    confirmed: NDArray[np.bool_]
    heights_confirmed: NDArray[np.bool_]
    leads: bool = False


@dataclass(frozen=True)
class ZoneSeries:
    """A tracked zone through time; arrays have one value a survey.

    ``means`` hold the zone's ground, which its polygon, area, mean change and volume are all of, and what each survey
    measured there; ``confirmed`` whether the survey confirms the zone. ``velocity``, ``angle`` and ``failure`` are of
    the heights; ``motion`` is that along the surface, where there is any, and ``found_by`` one of ``FOUND_BY``.
    ``history``: its alert level after each survey, None before it is judged; ``body``: the zone whose alert it shares
    (see ``bodies``). ``by_plants`` (n,): surveys whose change here may be that of the vegetation; they do not count.
    """

    track: Track
    means: ZoneMeans
    confirmed: NDArray[np.bool_]
    velocity: Velocity | None
    angle: TangentAngle
    failure: FailureTime
    alert: AlertLevel
    alert_reason: str
    found_by: str = FOUND_BY[0]
    motion: SurfaceMotion | None = None
    history: LevelHistory | None = None
    body: str = ""
    by_plants: NDArray[np.bool_] | None = None

    @property
    def kind(self) -> str:
        """One of ``KINDS``, or ``SLIDING`` where the heights show nothing."""
        return SLIDING if self.found_by == FOUND_BY[1] else KINDS[0] if self.track.sign < 0 else KINDS[1]

    @property
    def leading(self) -> Course:
        """The course that decides the zone's alert."""
        if self.motion is not None and self.motion.leads:
            return self.motion.course
        return Course(self.velocity, self.angle, self.failure)

    @property
    def cells(self) -> Index:
        """Its ground, flat indices."""
        return self.means.cells

    @property
    def change(self) -> Float:
        """Mean change, metres; NaN: not measured."""
        return self.means.change

    @property
    def variance(self) -> Float:
        """Each survey's own variance of ``change``, m²."""
        return self.means.variance

    @property
    def measured(self) -> Float:
        """Share of the ground that was measured."""
        return self.means.measured

    @property
    def fastest(self) -> float:
        """The larger one of its velocities of the heights and along the surface, metres a day."""
        courses = [self.velocity, None if self.motion is None else self.motion.course.velocity]
        return max((abs(v.rate) for v in courses if v is not None), default=0.0)

    @property
    def error(self) -> Float:
        """(n,) standard error of ``change``, the first survey's part included; 0 for the first."""
        error = np.sqrt(self.variance + self.variance[0])
        error[0] = 0.0
        return error

    @property
    def epochs_confirmed(self) -> int:
        return current_run(self.confirmed[1:].tolist(), (self.measured[1:] > 0).tolist())

    @property
    def last(self) -> int:
        """Index of the last survey that measured it; one that does not count is passed over if another is there."""
        known = np.isfinite(self.change)
        counted = known if self.by_plants is None else known & ~self.by_plants
        counted = counted if counted[1:].any() else known
        return int(np.flatnonzero(counted)[-1]) if counted.any() else 0


def zone_series(
    track: Track, means: ZoneMeans, days: Float, alerts: tuple[AlertLevel, ...], *, minimum_area: float
) -> ZoneSeries:
    """Series of one zone, from what each survey measured on its ground.

    A survey confirms a zone where the mean change is beyond its own level of detection with the zone's sign, and the
    significant change of that sign is at least ``minimum_area`` (m²).

    Args:
        days: (n,) days of the surveys since the first.
    """
    change, variance = means.change, means.variance
    seen = (means.lowered if track.sign < 0 else means.raised) >= minimum_area * (1 - 1e-9)
    with np.errstate(invalid="ignore"):
        beyond = np.abs(change) > Z95 * np.sqrt(variance + variance[0])
        confirmed = seen & beyond & (np.sign(change) == track.sign)
    confirmed[0] = False
    course = Course.of(days, change, variance)
    return ZoneSeries(track, means, confirmed, course.velocity, course.angle, course.failure, alerts[0], "")
