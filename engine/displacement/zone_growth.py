"""Zones that move as one: where windows together stand out, the ground that moves with them, and one fit over it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, spatial

from ..core.arrays import Bool, Float, Index
from .frame import Frame
from .scan import Layout, Peak, map_probability, peaks, trials_of
from .vectors import Vectors, common_motion, likelihood_ratio
from .zones import FitPlan, Measured, MovingZone, fit_zone

MAX_ZONE_PROBABILITY = 0.03
"""That still ground shows a zone anywhere on the map, with errors as stated. Aimed at is a false zone on at most 5 % of
still maps; the rest is for errors that are too small."""
_FARTHER_ODDS = float(np.log(10.0))
"""Windows beyond what stood out must move with the zone ten times as likely as stand still; within it, as likely."""
_CORE_SHARE = 0.6  # of the radius of what stood out, for the first fit
_EDGE_SHARE = 0.25  # of a narrow window's radius, that is taken off a zone's cells before the fit

ErrorAt = Callable[[Float], Float]
"""Covariance (n, 3, 3) that the registration adds at places (n, 3), m²."""


@dataclass(frozen=True)
class _Field:
    """The windows of each width, narrow ones first, without the registration's error; what they are made of."""

    widths: Sequence[Vectors]
    measured: Measured
    layout: Layout
    error_at: ErrorAt

    @property
    def places(self) -> Float:
        return self.widths[0].places

    @property
    def narrow(self) -> float:
        """Width of the narrowest windows, metres."""
        return float(self.widths[0].width[0])


def moving_zones(
    widths: Sequence[Vectors], measured: Measured, least_area: float, error_at: ErrorAt
) -> list[MovingZone]:
    """The zones that still ground hardly shows, largest first.

    Args:
        widths: windows of each width, narrow ones first, with what is taken off, without the registration's error.
        least_area: m²; smaller zones are left out.
        error_at: covariance (n, 3, 3) that is added at places (n, 3).
    """
    layout = Layout(measured.cells, measured.facet, measured.facets.frames, measured.spacing)
    widths = [_as_they_scatter(vectors) for vectors in widths]
    field = _Field(widths, measured, layout, error_at)
    left = [vectors.measured.copy() for vectors in widths]
    tests = trials_of(layout, np.any(left, axis=0), field.narrow)
    if not tests:
        return []
    least = -2.0 * float(np.log(-np.log1p(-MAX_ZONE_PROBABILITY) / tests))
    error = error_at(field.places)
    found: list[MovingZone] = []
    while True:
        again = False
        for peak in peaks(widths, left, layout, error, least):
            again = True
            windows, zone = _grown(peak, field, left, least_area)
            _take_out(windows, peak, field, left)
            if zone is not None:
                motion, covariance, fitted = zone
                found.append(_zone(windows, motion, covariance, fitted, map_probability(peak.statistic, tests), field))
        if not again:
            return sorted(found, key=lambda zone: -zone.area)


def _as_they_scatter(vectors: Vectors) -> Vectors:
    """With larger covariances where most windows scatter more about their common motion than is stated."""
    common = common_motion(vectors, 1.0)
    factor = 1.0 if common is None or not common.factor > 1.0 else common.factor
    return replace(vectors, covariance=vectors.covariance * factor)


def _zone(
    windows: Index, motion: Float, covariance: Float, fitted: float, probability: float, field: _Field
) -> MovingZone:
    axes = field.layout.frames[int(field.layout.facet[windows[0]])].axes
    area = len(windows) * field.layout.spacing**2
    return MovingZone(
        windows, area, motion, covariance, axes @ motion, axes @ covariance @ axes.T, probability, fitted
    )  # fmt: skip


def _grown(
    peak: Peak, field: _Field, left: Sequence[Bool], least_area: float
) -> tuple[Index, tuple[Float, Float, float] | None]:
    """The windows that move with a peak, and one fit over them; its core and no fit where they are too few."""
    frame = field.layout.frames[peak.facet]
    flat = frame.to_plane(field.places)[:, :2]
    off = np.hypot(*(flat - flat[peak.window]).T)
    mine = field.layout.facet == peak.facet
    core = np.flatnonzero(mine & (off <= _CORE_SHARE * peak.radius))
    near = mine & (off <= peak.radius - field.layout.spacing / 2)
    shift = (frame.axes @ field.measured.taken_off)[:2]
    plan = FitPlan(peak.motion + shift, _EDGE_SHARE * field.narrow / 2, field.narrow)
    first = fit_zone(core, field.places, field.measured, field.error_at, FitPlan(plan.start, 0.0, field.narrow))
    guesses = [peak.motion] if first is None else [(frame.axes @ first[0])[:2], peak.motion]
    for motion in guesses:
        windows = _moving_with(motion, field, left, mine, near)
        if len(windows) * field.layout.spacing**2 < least_area or not len(windows):
            continue
        zone = fit_zone(
            windows, field.places, field.measured, field.error_at, FitPlan(motion + shift, plan.margin, plan.width)
        )
        if zone is not None:
            return windows, zone
    return core, None


def _moving_with(motion: Float, field: _Field, left: Sequence[Bool], mine: Bool, near: Bool) -> Index:
    """Adjoining windows that rather move by ``motion`` (2,) than stand still, most of them where it stood out."""
    ratio = np.zeros(len(mine))
    for vectors, usable in zip(field.widths, left, strict=True):
        use = usable & mine
        ratio[use] += likelihood_ratio(vectors, motion)[use]
    moving = mine & (ratio > np.where(near, 0.0, _FARTHER_ODDS))
    cells = field.layout.cells - field.layout.cells.min(axis=0)
    taken = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    taken[tuple(cells[moving].T)] = True
    label = ndimage.label(taken, np.ones((3, 3)))[0][tuple(cells.T)]
    seeds = label[moving & near]
    if not len(seeds):
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(moving & (label == np.argmax(np.bincount(seeds))))


def _take_out(windows: Index, peak: Peak, field: _Field, left: Sequence[Bool]) -> None:
    """From ``left`` those windows of each width that share ground with a zone, and the peak's own."""
    frame: Frame = field.layout.frames[peak.facet]
    flat = frame.to_plane(field.places)
    distance = spatial.cKDTree(flat[np.append(windows, peak.window)]).query(flat)[0]
    for vectors, usable in zip(field.widths, left, strict=True):
        usable[distance < vectors.width] = False
