"""Zones that are parts of one moving body: they adjoin, move alike, and have one alert."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Float
from ..displacement.zones import MAX_TURN_DEG
from ..grid.grid import Grid
from ..statistics.normal import Z95
from .zone_series import ZoneSeries

_MAX_GAP_M = 2.0  # between zones of one body: twice the side of the smallest zone
_UNEVEN_SHARE = 0.2  # by which the displacements of one may differ from the other's beyond their errors


def with_bodies(zones: Sequence[ZoneSeries], grid: Grid) -> tuple[ZoneSeries, ...]:
    """The zones, each with the name of the zone whose alert it shares; that one has its own name.

    Of zones that adjoin and move alike, the one with the highest level leads, then the largest. The others have its
    level and state, and say so.
    """
    labels = _bodies(zones, grid)
    found = list(zones)
    for label in set(labels):
        members = [number for number, own in enumerate(labels) if own == label]
        lead = min(members, key=lambda i: (-zones[i].alert.level, -len(zones[i].cells), zones[i].track.zone_id))
        name = zones[lead].track.zone_id
        for number in members:
            zone = replace(zones[number], body=name)
            if number != lead and zones[lead].alert.level:
                reason = f"one body with {name}: {zones[lead].alert_reason}"
                zone = replace(zone, alert=zones[lead].alert, alert_reason=reason)
            found[number] = zone
    return tuple(found)


def _bodies(zones: Sequence[ZoneSeries], grid: Grid) -> list[int]:
    """Number of each zone's body."""
    labels = list(range(len(zones)))
    middles = [np.column_stack(np.divmod(zone.cells, grid.columns)) * grid.cell for zone in zones]
    trees = [cKDTree(places) for places in middles]
    for i, zone in enumerate(zones):
        for j in range(i):
            if labels[j] == labels[i] or not move_alike(zone, zones[j]):
                continue
            gap = float(np.min(trees[i].query(middles[j], distance_upper_bound=_MAX_GAP_M + grid.cell + 1e-6)[0]))
            if np.isfinite(gap):
                labels = [labels[i] if own == labels[j] else own for own in labels]
    return labels


def move_alike(one: ZoneSeries, other: ZoneSeries) -> bool:
    """Whether two zones move in one direction at the same times.

    The displacements of one, times a factor above zero, are those of the other within the errors (95 %) and a fifth of
    their size: parts of one body do not move quite alike.
    """
    if (one.motion is None) != (other.motion is None) or (one.motion is None and one.track.sign != other.track.sign):
        return False
    (x, v), (y, w) = _displacements(one), _displacements(other)
    known = np.isfinite(x) & np.isfinite(y)
    known[0] = False
    if not known.any():
        return False
    x, y, v, w = x[known], y[known], v[known] + v[0], w[known] + w[0]
    if one.motion is not None and other.motion is not None:
        along = float(one.motion.ground.direction @ other.motion.ground.direction)
        if along < np.cos(np.radians(MAX_TURN_DEG)):
            return False
    factor = float(np.sum(x * y / w) / np.sum(x * x / w))
    if factor <= 0:
        return False
    rest = np.abs(y - factor * x) / np.sqrt(w + factor**2 * v)
    return bool(np.all(rest <= Z95 + _UNEVEN_SHARE * np.abs(y) / np.sqrt(w)))


def _displacements(zone: ZoneSeries) -> tuple[Float, Float]:
    if zone.motion is not None:
        return zone.motion.ground.along, zone.motion.ground.along_variance
    return zone.change, zone.variance
