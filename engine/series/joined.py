"""Zones found by heights and ground found by its motion along the surface, joined: what is one place is one zone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.arrays import Float, Index
from ..grid.grid import Grid
from ..statistics.normal import Z95
from .alerts import AlertLevel
from .motion.windows import Layout
from .motion.zones import MovingGround
from .tracking import Sighting, Track
from .zone_means import ZoneMeans
from .zone_series import FOUND_BY, Course, SurfaceMotion, ZoneSeries, zone_series

_MIN_SHARED_SHARE = 0.25  # of the smaller one's area: less in common is a touch, not the same place


def joined_zones(
    zones: Sequence[ZoneSeries],
    ground: Sequence[tuple[MovingGround, ZoneMeans]],
    layout: Layout,
    grid: Grid,
    days: Float,
    alerts: tuple[AlertLevel, ...],
) -> tuple[ZoneSeries, ...]:
    """The zones with the motion of the ground that they have most area in common with, then the ground without one.

    Each ground is one zone and each zone has one ground at most. Where the heights of ground that moves along the
    surface show nothing, its zone has their figures over the same cells all the same.

    Args:
        ground: each with what the heights are on its cells.
        layout: of the windows of ``ground``.
        grid: of the changes and of the zones' cells.
        days: (n,) days of the surveys since the first.
    """
    taken: dict[int, int] = {}
    for number, other in _matches([zone.cells for zone in zones], [means.cells for _, means in ground]):
        taken[number] = other
    found = [with_motion(zone, *ground[taken[n]], days) if n in taken else zone for n, zone in enumerate(zones)]
    for number, (one, means) in enumerate(ground):
        if number not in taken.values():
            own = zone_series(_track(one, means, layout, grid), means, days, alerts, minimum_area=np.inf)
            own = replace(own, found_by=FOUND_BY[1])
            found.append(with_motion(own, one, means, days))
    return tuple(found)


def cells_of(windows: Index, layout: Layout, grid: Grid) -> Index:
    """Cells of a grid (flat indices, sorted) whose middles lie in the cells of ``windows``."""
    inside = np.zeros(layout.grid.shape, dtype=bool)
    inside.ravel()[layout.cell[windows]] = True
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    column = np.floor((x - layout.grid.west) / layout.grid.cell).astype(np.int64)
    row = np.floor((layout.grid.north - y) / layout.grid.cell).astype(np.int64)
    columns = np.flatnonzero((column >= 0) & (column < layout.grid.columns))
    rows = np.flatnonzero((row >= 0) & (row < layout.grid.rows))
    found = inside[np.ix_(row[rows], column[columns])]
    return np.sort((rows[:, None] * grid.columns + columns[None, :])[found])


def _matches(zones: Sequence[Index], ground: Sequence[Index]) -> list[tuple[int, int]]:
    """Numbers of a zone and of the ground that is the same place, those with most in common first."""
    pairs = []
    for number, own in enumerate(zones):
        for other, cells in enumerate(ground):
            common = len(np.intersect1d(own, cells, assume_unique=True))
            if common and common >= _MIN_SHARED_SHARE * min(len(own), len(cells)):
                pairs.append((-common, number, other))
    found: list[tuple[int, int]] = []
    for _, number, other in sorted(pairs):
        if all(number != n and other != o for n, o in found):
            found.append((number, other))
    return found


def with_motion(zone: ZoneSeries, ground: MovingGround, means: ZoneMeans, days: Float) -> ZoneSeries:
    """A zone with the motion of its ground."""
    along, error = ground.along, ground.along_error
    course = Course.of(days, along, ground.along_variance)
    with np.errstate(invalid="ignore"):
        moved = np.nan_to_num(along) > Z95 * np.nan_to_num(error, nan=np.inf)
    moved[0] = False
    if zone.found_by == FOUND_BY[0] and ground.found < int(np.argmax(zone.confirmed)):
        # the motion showed it first: it keeps the name that it had then
        zone = replace(zone, track=replace(zone.track, zone_id=ground.zone_id))
    return replace(
        zone,
        confirmed=zone.confirmed | moved,
        found_by=FOUND_BY[1] if zone.found_by == FOUND_BY[1] else FOUND_BY[2],
        motion=SurfaceMotion(ground, means.cells, course, moved, zone.confirmed),
    )


def _track(one: MovingGround, means: ZoneMeans, layout: Layout, grid: Grid) -> Track:
    """Ground that moves as a track of zones of the heights."""
    known = means.change[np.isfinite(means.change)]
    sightings = tuple(
        Sighting(
            s.epoch,
            cells_of(layout.number[s.cells], layout, grid),
            s.event,
            tuple(f"M{other[1:]}" for other in s.others),
        )
        for s in one.sightings
    )
    return Track(one.zone_id, 1 if known[-1] > 0 else -1, sightings, means.cells, one.parent, "")
