"""Time series of the zones of a series: their mean change survey by survey, with errors, velocity and alert level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Float, Index
from ..statistics.normal import Z95
from ..zones.fields import KINDS, SLIDING
from .alerts import AlertLevel
from .inverse_velocity import MAX_CHANCE, FailureTime, failure_time
from .level_history import LevelHistory
from .motion.zones import MovingGround
from .patch_errors import PatchErrors, away_from, patch_errors
from .persistence import current_run
from .tangent_angle import LEVELS as TANGENT_LEVELS
from .tangent_angle import TangentAngle, tangent_angle
from .tracking import Track
from .velocity import Velocity, zone_velocity

_MIN_MEASURED_SHARE = 0.1  # of a zone's cells: with fewer a survey did not measure it


@dataclass(frozen=True)
class Stack:
    """The surveys of a series against the first, on one grid. Lists have one entry a survey, the first included.

    Attributes:
        days: (n,) days since the first survey.
        change: (rows, columns) metres against the first survey; 0 in its own cells, NaN where not measured.
        variance: (rows, columns) each survey's own sampling variance, m².
        shared: each survey's registration error, metres; 0 for the first.
        significant: cells beyond their level of detection; none for the first.
        cell: side of a cell, metres.
        plants: (rows, columns) each survey's own error by plants, metres, which neighbours share; none without.
    """

    days: Float
    change: Sequence[Float]
    variance: Sequence[Float]
    shared: Sequence[float]
    significant: Sequence[NDArray[np.bool_]]
    cell: float
    plants: Sequence[Float] = ()

    @property
    def cell_variance(self) -> list[Float]:
        """Each survey's own variance of a cell, plants included, m²."""
        if not self.plants:
            return list(self.variance)
        return [own + plant**2 for own, plant in zip(self.variance, self.plants, strict=True)]

    def mean_plants(self, survey: int, cells: Index) -> float:
        """Error by plants of the mean change of ``cells`` (flat indices), which averages nothing out, metres."""
        return float(self.plants[survey].ravel()[cells].mean()) if self.plants else 0.0


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
        """From displacements (n,) and their own variances, as for ``zone_velocity``."""
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

    ``cells`` (flat indices) is its footprint with gaps and holes filled: all measured cells in it count, significant or
    not, so that noise does not choose which. ``change`` is their mean in metres (NaN: not measured), ``variance``
    each survey's own variance of it (m²), ``measured`` the number of cells, ``confirmed`` whether the survey
    confirms the zone. ``velocity``, ``angle`` and ``failure`` are of the heights; ``motion`` is that along the surface,
    where there is any, and ``found_by`` one of ``FOUND_BY``. ``history``: its alert level after each survey, None
    before it is judged; ``body``: the zone whose alert it shares (see ``bodies``).
    """

    track: Track
    cells: Index
    change: Float
    variance: Float
    measured: NDArray[np.int64]
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
    def outline(self) -> Index:
        """Its cells, and those that move along the surface."""
        return self.cells if self.motion is None else np.union1d(self.cells, self.motion.cells)

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
        """Index of the last survey that measured it."""
        return int(np.flatnonzero(np.isfinite(self.change))[-1]) if np.isfinite(self.change).any() else 0


def zone_series(
    tracks: Sequence[Track],
    stack: Stack,
    alerts: tuple[AlertLevel, ...],
    *,
    minimum_area: float,
    bridged: int,
) -> tuple[ZoneSeries, ...]:
    """Series of every zone.

    A survey confirms a zone where the mean change is beyond its own level of detection with the zone's sign, and the
    zone's significant cells of that sign are at least ``minimum_area`` (m²).

    The mean's error holds the sampling of its cells; the registration and the plants, or what patches of stable ground
    of the zone's size show if that is more; and, where a survey measured only part of the zone, the scatter of the
    change within it.

    Args:
        bridged: gap in cells up to which the footprint is closed.
    """
    shared = shared_errors(tracks, stack, bridged)
    shape = stack.change[0].shape
    return tuple(
        series_of(track, _filled(track.footprint, shape, bridged), stack, shared, alerts, minimum_area)
        for track in tracks
    )


def shared_errors(tracks: Sequence[Track], stack: Stack, bridged: int) -> list[PatchErrors]:
    """Of each survey what patches of ground away from all ``tracks`` show of the errors of means."""
    moved = np.zeros(stack.change[0].shape, dtype=bool)
    for track in tracks:
        moved.ravel()[track.footprint] = True
    stable = away_from(moved, max(2, bridged))
    return [
        patch_errors(dz, own + stack.variance[0], stable) for dz, own in zip(stack.change, stack.variance, strict=True)
    ]


def _filled(cells: Index, shape: tuple[int, ...], bridged: int) -> Index:
    """The footprint closed over ``bridged`` cells, its holes filled (flat indices)."""
    row, column = np.divmod(cells, shape[1])
    edge = bridged + 1
    top, left = int(row.min()) - edge, int(column.min()) - edge
    part = np.zeros((int(row.max()) - top + edge + 1, int(column.max()) - left + edge + 1), dtype=bool)
    part[row - top, column - left] = True
    if bridged:
        size = bridged // 2 * 2 + 1
        part = ndimage.binary_closing(part, np.ones((size, size), dtype=bool)) | part
    filled = np.argwhere(ndimage.binary_fill_holes(part)) + (top, left)
    inside = ((filled >= 0) & (filled < shape)).all(axis=1)
    return filled[inside, 0] * shape[1] + filled[inside, 1]


def series_of(
    track: Track,
    cells: Index,
    stack: Stack,
    shared: Sequence[PatchErrors],
    alerts: tuple[AlertLevel, ...],
    minimum_area: float,
) -> ZoneSeries:
    """The series of one zone over ``cells`` (flat indices); see ``zone_series``."""
    count = len(stack.days)
    change, variance = np.full(count, np.nan), np.full(count, np.nan)
    measured, seen = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    values = [dz.ravel()[cells] for dz in stack.change]
    ever = int(np.count_nonzero(np.any([np.isfinite(v) for v in values[1:]], axis=0)))
    least = max(3, _MIN_MEASURED_SHARE * ever)
    for i, dz in enumerate(values):
        own = stack.variance[i].ravel()[cells]
        known = np.isfinite(dz) & np.isfinite(own)
        n = int(np.count_nonzero(known))
        if n < least:
            continue
        measured[i] = n
        change[i] = dz[known].mean()
        by_plants = stack.mean_plants(i, cells[known]) ** 2
        common = max(stack.shared[i] ** 2 + by_plants, shared[i].excess_of(n) if i else 0.0)
        # of a part measured, the mean differs from that of the whole by the scatter within
        partial = dz[known].var() / n * max(0.0, 1.0 - n / max(ever, 1)) if i else 0.0
        variance[i] = own[known].sum() / n**2 + common + partial
        signed = stack.significant[i].ravel()[cells] & (np.nan_to_num(dz) * track.sign > 0)
        seen[i] = np.count_nonzero(signed) * stack.cell**2 >= minimum_area * (1 - 1e-9)
    with np.errstate(invalid="ignore"):
        beyond = np.abs(change) > Z95 * np.sqrt(variance + variance[0])
        confirmed = seen & beyond & (np.sign(change) == track.sign)
    confirmed[0] = False
    course = Course.of(stack.days, change, variance)
    return ZoneSeries(
        track,
        cells,
        change,
        variance,
        measured,
        confirmed,
        course.velocity,
        course.angle,
        course.failure,
        alerts[0],
        "",
    )
