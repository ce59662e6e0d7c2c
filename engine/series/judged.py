"""Alert levels of the zones of a series, from their heights or their motion along the surface, whichever is higher."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..change.result import Change
from ..change.season import explained_by_plants
from ..core.arrays import Bool, Float
from ..displacement.gravity import is_uphill
from ..statistics.normal import Z95
from .alerts import AlertLevel
from .level_history import Displacements, LevelHistory, level_history
from .motion.zones import MovingGround
from .zone_series import Course, ZoneSeries

_MAX_PLANT_LIKE_SHARE = 0.5  # of a zone's measured cells: with more, its change may be that of the vegetation


def judged_zones(
    zones: Sequence[ZoneSeries], days: Float, changes: Iterable[Change], alerts: tuple[AlertLevel, ...]
) -> tuple[ZoneSeries, ...]:
    """The zones with their levels after each survey.

    The heights of a survey do not count for a zone, nor for its velocity, if vegetation explains the change in most of
    its cells (``season.explained_by_plants``), or its mean change since the last survey that counts. Motion along the
    surface that is uphill beyond chance is a doubt and gives no level.

    Args:
        days: (n,) days of the surveys since the first.
        changes: of the surveys from the second on against the first.
    """
    shape = len(zones), len(days)
    plant_like, heights = np.zeros(shape, dtype=bool), np.full(shape, np.nan)
    for survey, change in enumerate(changes, 1):
        if change.plant_like is not None:
            plant_like[:, survey] = [_is_plant_like(zone, change.dz, change.plant_like) for zone in zones]
        if change.plants is not None and change.plants.height_from is not None and change.plants.height_to is not None:
            if survey == 1:
                heights[:, 0] = [_height(zone, change.plants.height_from) for zone in zones]
            heights[:, survey] = [_height(zone, change.plants.height_to) for zone in zones]
    return tuple(
        _judged(zone, days, _by_plants(zone, *of_zone), alerts)
        for zone, of_zone in zip(zones, zip(plant_like, heights, strict=True), strict=True)
    )


def _is_plant_like(zone: ZoneSeries, dz: Float, plant_like: Bool) -> bool:
    known = np.isfinite(dz.ravel()[zone.cells])
    return bool(known.any()) and float(np.mean(plant_like.ravel()[zone.cells][known])) > _MAX_PLANT_LIKE_SHARE


def _height(zone: ZoneSeries, height: Float) -> float:
    """Median height of the vegetation on a zone, metres; NaN if it is not known."""
    values = height.ravel()[zone.cells]
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else np.nan


def _by_plants(zone: ZoneSeries, plant_like: Bool, heights: Float) -> Bool:
    """Surveys (n,) whose mean change vegetation may explain, from its ``heights`` (n,) on the zone."""
    found, before = plant_like.copy(), 0
    for survey in range(1, len(found)):
        if found[survey] or not np.isfinite(zone.change[survey]):
            continue
        dz = zone.change[survey] - zone.change[before]
        level = Z95 * np.sqrt(zone.variance[survey] + zone.variance[before])
        found[survey] = bool(explained_by_plants(dz, level, heights[before], heights[survey]))
        before = before if found[survey] else survey
    return found


def _judged(zone: ZoneSeries, days: Float, plants: Bool, alerts: tuple[AlertLevel, ...]) -> ZoneSeries:
    if plants.any():
        course = Course.of(days, np.where(plants, np.nan, zone.change), zone.variance)
        zone = replace(zone, velocity=course.velocity, angle=course.angle, failure=course.failure, by_plants=plants)
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
    if moves_uphill(ground):
        reason = f"doubtful: the motion is uphill, {abs(ground.off_dip):.0f} degrees off the dip"
        return LevelHistory((0,) * len(days), ("",) * len(days), (reason,) * len(days))
    none = np.zeros(len(days))
    return level_history(
        Displacements(days, ground.along, ground.along_variance, moved, none, along_surface=True), alerts
    )


def moves_uphill(ground: MovingGround) -> bool:
    """Whether ground moves against gravity, see ``is_uphill``, until the last survey that shows it."""
    dip = ground.axes[0]
    last = int(np.flatnonzero(np.isfinite(ground.along))[-1])
    error = float(np.sqrt(dip @ ground.covariance[last, :, last] @ dip))
    return bool(is_uphill(dip, ground.motion[last] @ dip, np.asarray(error)))


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
