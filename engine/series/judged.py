"""Alert levels of the zones of a series, from their heights or their motion along the surface, whichever is higher."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..change.result import Change
from ..core.arrays import Bool, Float
from ..statistics.normal import Z95
from .alerts import AlertLevel
from .level_history import Displacements, LevelHistory, level_history
from .motion.zones import MovingGround
from .zone_series import Course, ZoneSeries

_MAX_PLANT_LIKE_SHARE = 0.5  # of a zone's measured cells: with more, its change may be that of the vegetation
_MIN_INCLINATION_DEG = 10.0  # below it ground heaves at the toe of a slide, and the dip is no direction to go by


def judged_zones(
    zones: Sequence[ZoneSeries], days: Float, changes: Iterable[Change], alerts: tuple[AlertLevel, ...]
) -> tuple[ZoneSeries, ...]:
    """The zones with their levels after each survey.

    The heights of a survey do not count for a zone where vegetation explains the change in most of its cells
    (``season.explained_by_plants``). Motion along the surface that is uphill beyond chance is a doubt and gives no
    level.

    Args:
        days: (n,) days of the surveys since the first.
        changes: of the surveys from the second on against the first.
    """
    by_plants = np.zeros((len(zones), len(days)), dtype=bool)
    for survey, change in enumerate(changes, 1):
        if change.plant_like is not None:
            by_plants[:, survey] = [_is_plant_like(zone, change.dz, change.plant_like) for zone in zones]
    return tuple(_judged(zone, days, plants, alerts) for zone, plants in zip(zones, by_plants, strict=True))


def _is_plant_like(zone: ZoneSeries, dz: Float, plant_like: Bool) -> bool:
    known = np.isfinite(dz.ravel()[zone.cells])
    return bool(known.any()) and float(np.mean(plant_like.ravel()[zone.cells][known])) > _MAX_PLANT_LIKE_SHARE


def _judged(zone: ZoneSeries, days: Float, plants: Bool, alerts: tuple[AlertLevel, ...]) -> ZoneSeries:
    history = level_history(_heights(zone, days, plants), alerts)
    leads = False
    if zone.motion is not None:
        along = _of_motion(zone.motion.ground, zone.motion.confirmed, days, alerts)
        leads = along.levels[-1] > history.levels[-1] or (
            along.levels[-1] == history.levels[-1]
            and _sureness(zone.motion.course) >= _sureness(Course(zone.velocity, zone.angle, zone.failure))
        )
        zone = replace(zone, motion=replace(zone.motion, leads=leads))
        history = _higher(history, along, leads)
    return replace(zone, history=history, alert=alerts[history.levels[-1]], alert_reason=history.reasons[-1])


def _heights(zone: ZoneSeries, days: Float, plants: Bool) -> Displacements:
    confirmed = zone.confirmed if zone.motion is None else zone.motion.heights_confirmed
    change = np.where(plants, np.nan, zone.change)
    area = np.where(np.isfinite(zone.change), zone.means.area, 0.0)
    return Displacements(days, change, zone.variance, confirmed & ~plants, area)


def _of_motion(ground: MovingGround, moved: Bool, days: Float, alerts: tuple[AlertLevel, ...]) -> LevelHistory:
    if is_uphill(ground):
        reason = f"doubtful: the motion is uphill, {abs(ground.off_dip):.0f} degrees off the dip"
        return LevelHistory((0,) * len(days), ("",) * len(days), (reason,) * len(days))
    none = np.zeros(len(days))
    return level_history(
        Displacements(days, ground.along, ground.along_variance, moved, none, along_surface=True), alerts
    )


def is_uphill(ground: MovingGround) -> bool:
    """Whether ground on a slope moves against gravity beyond chance: a fault of the surveys, for all that is known."""
    dip = ground.axes[0]
    last = int(np.flatnonzero(np.isfinite(ground.along))[-1])
    error = float(np.sqrt(dip @ ground.covariance[last, :, last] @ dip))
    return bool(abs(dip[2]) > np.sin(np.radians(_MIN_INCLINATION_DEG)) and ground.motion[last] @ dip < -Z95 * error)


def _higher(heights: LevelHistory, along: LevelHistory, leads: bool) -> LevelHistory:
    """Of both the higher one after each survey; at the last, and where they are equal, that which leads."""
    take = [a > h or (a == h and leads) for a, h in zip(along.levels, heights.levels, strict=True)]
    parts = ("levels", "states", "reasons")
    if not leads and not any(heights.reasons) and along.levels[-1] == 0:
        take = [True] * len(take)  # a doubt is said where nothing else is
    return LevelHistory(
        *(
            tuple(a if use else h for use, a, h in zip(take, getattr(along, p), getattr(heights, p), strict=True))
            for p in parts
        )
    )


def _sureness(course: Course) -> float:
    """Standard errors by which the velocity is away from zero."""
    velocity = course.velocity
    return 0.0 if velocity is None or not velocity.error else abs(velocity.rate) / velocity.error
