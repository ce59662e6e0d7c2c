"""More than two surveys on one grid: cumulative and stepwise change, zones through time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import GridChangeParameters, ZoneParameters
from ..change.difference import Areas, difference_of_cells
from ..change.doubts import warn_of_doubtful_change
from ..change.result import Change
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.named_progress import NamedProgress
from ..core.progress import Progress
from ..displacement.registered import Registered
from ..epochs.epoch import Epoch
from ..geometry.rigid_transform import RigidTransform
from ..grid.cell_statistics import CellStatistics
from ..grid.grid import Grid
from ..grid.pooled_variance import pooled_variance
from ..pointcloud.in_parts import SpooledCloud
from ..zones.groups import label_groups
from .alerts import AlertLevel
from .bodies import with_bodies
from .joined import joined_zones
from .judged import judged_zones
from .kept_changes import KeptChanges
from .motion.windows import Layout
from .motion.zones import MovingGround
from .persistence import confirmed_cells
from .tracking import Track, track_zones
from .velocity import own_variances
from .zone_series import Stack, ZoneSeries, shared_errors, zone_series


@dataclass(frozen=True)
class GriddedEpoch:
    """A survey in the frame and on the grid of the first one; ``load`` reads its cells, which no one else holds, and
    ``points`` its ``ground`` (n, 3) in that frame, metres, and ``stored`` the same in a folder on the disk; ``key``
    stands for all that they depend on.

    ``registration_error`` is the standard error of a height (m), 0 for the first; ``registered`` that of all six
    unknowns; ``area`` the part of the region of
    interest that both it and the first survey hold. ``facts`` state what was done, and ``made`` which steps were not
    reused (ground, registration, cells).
    """

    epoch: Epoch
    transform: RigidTransform
    registration_error: float
    load: Callable[[], CellStatistics]
    points: Callable[[], Float]
    stored: Callable[[Path], SpooledCloud]
    ground: Path
    key: str
    registered: Registered
    area: BaseGeometry | None
    facts: dict[str, Any]
    made: tuple[str, ...]


@dataclass(frozen=True)
class Analysis:
    """Results of the gridded surveys. Changes have one entry a survey from the second on, read when it is asked for.

    ``confirmed`` (rows, columns) counts comparisons in a row that show a cell changed within a group of at least the
    least area: a single cell that the first survey's noise lifted would stand out in all comparisons.
    """

    cumulative: Sequence[Change]
    incremental: Sequence[Change]
    stack: Stack
    tracks: tuple[Track, ...]
    zones: tuple[ZoneSeries, ...]
    confirmed: NDArray[np.int64]
    unconfirmed: int


def analyse(
    gridded: Sequence[GriddedEpoch],
    grid: Grid,
    parameters: tuple[GridChangeParameters, ZoneParameters],
    alerts: tuple[AlertLevel, ...],
    folder: Path,
    *,
    stable: BaseGeometry | None = None,
    progress: Progress | None = None,
) -> Analysis:
    """Differences, zones and their series of surveys that are on one grid; the first one's own transform is none.

    A survey whose whole overlap rose or sank alike (a datum or bias, see ``difference.uniform_shift``) makes no zones
    and gives no velocity.

    Args:
        folder: for the changes as long as the analysis is in use.
    """
    cumulative, incremental, sampling = _compared(gridded, grid, parameters[0], folder, stable, progress or Progress())
    stack = _stack(gridded, cumulative, grid, sampling)
    del sampling
    zone_parameters = parameters[1]
    groups, levels = [], []
    for number, change in enumerate(cumulative, 1):
        plants = None if change.plants is None else change.plants.error
        labels = label_groups(change.dz, stack.significant[number], zone_parameters, change.partition, plants=plants)
        groups.append((number, labels, np.sign(np.nan_to_num(change.dz)).astype(np.int8)))
        levels.append(np.where(labels > 0, change.level, np.inf))
    tracks = track_zones(groups, max(1, _reach(zone_parameters, grid)))
    del groups
    bridged = _bridged(zone_parameters, grid)
    found = zone_series(_living(tracks), stack, alerts, minimum_area=zone_parameters.minimum_area, bridged=bridged)
    confirmed_zones = [z for z in found if z.confirmed.any()]
    zones = with_bodies(judged_zones(confirmed_zones, stack.days, cumulative, grid.cell, alerts), grid)
    confirmed = confirmed_cells([c.dz for c in cumulative], levels)
    return Analysis(cumulative, incremental, stack, tracks, zones, confirmed, len(found) - len(zones))


def with_ground(
    analysis: Analysis,
    ground: Sequence[MovingGround],
    layout: Layout,
    grid: Grid,
    parameters: ZoneParameters,
    alerts: tuple[AlertLevel, ...],
) -> Analysis:
    """The analysis with the ground that moves along the surface, which is one zone with a zone in the same place.

    Args:
        layout: of the windows of ``ground``.
        grid, parameters, alerts: as for ``analyse``.
    """
    if not ground:
        return analysis
    living, bridged = _living(analysis.tracks), _bridged(parameters, grid)
    shared = shared_errors(living, analysis.stack, bridged)
    zones = joined_zones(analysis.zones, ground, layout, grid, analysis.stack, shared, alerts)
    zones = with_bodies(judged_zones(zones, analysis.stack.days, analysis.cumulative, grid.cell, alerts), grid)
    return replace(analysis, zones=zones)


def _reach(parameters: ZoneParameters, grid: Grid) -> int:
    return int(parameters.bridged_gap / (2.0 * grid.cell) + 1e-6)


def _bridged(parameters: ZoneParameters, grid: Grid) -> int:
    """Gap in cells up to which footprints are closed."""
    return max(2, 2 * _reach(parameters, grid))


def _living(tracks: Sequence[Track]) -> list[Track]:
    return [t for t in tracks if not t.merged_into and len(t.footprint)]


def _compared(
    gridded: Sequence[GriddedEpoch],
    grid: Grid,
    parameters: GridChangeParameters,
    folder: Path,
    stable: BaseGeometry | None,
    progress: Progress,
) -> tuple[KeptChanges, KeptChanges, list[Float]]:
    """Changes against the first survey and against the one before, and each survey's sampling variance of a cell."""
    names = [g.epoch.name for g in gridded]
    shares = [NamedProgress(s, n) for s, n in zip(progress.split(names), names, strict=True)]
    cumulative, incremental = KeptChanges(folder, "cumulative"), KeptChanges(folder, "incremental")
    first = before = gridded[0].load()
    sampling = [_sampling(first)]
    for number, (last, this) in enumerate(pairwise(gridded), 1):
        progress.update(number / len(gridded), f"comparing {this.epoch.name}")
        later = this.load()
        try:
            change = _difference((gridded[0], first), (this, later), grid, parameters, stable)
            # all along the direction of the first comparison
            parameters = replace(parameters, direction=change.direction)
            cumulative.add(change)
            warn_of_doubtful_change(change, shares[number], may_grow=False)
            del change
            if number == 1:
                incremental.again(cumulative, 0)
            else:
                incremental.add(_difference((last, before), (this, later), grid, parameters, stable))
        except InputError as wrong:
            raise InputError(f"{this.epoch.name}: {wrong}") from wrong
        sampling.append(_sampling(later))
        before = later
    return cumulative, incremental, sampling


def _sampling(cells: CellStatistics) -> Float:
    return cells.on_grid(cells.leverage * pooled_variance(cells))


def _difference(
    earlier: tuple[GriddedEpoch, CellStatistics],
    later: tuple[GriddedEpoch, CellStatistics],
    grid: Grid,
    parameters: GridChangeParameters,
    stable: BaseGeometry | None,
) -> Change:
    (a, before), (b, after) = earlier, later
    area = a.area if b.area is None else b.area if a.area is None else a.area.intersection(b.area)
    error = float(np.hypot(a.registration_error, b.registration_error))
    return difference_of_cells(before, after, grid, parameters, error, Areas(area, stable))


def _stack(gridded: Sequence[GriddedEpoch], cumulative: Sequence[Change], grid: Grid, sampling: list[Float]) -> Stack:
    """The surveys of the cumulative changes, of which each is looked at once."""
    nothing = np.zeros(grid.shape)
    of_first, plants, without, shared = nothing, [], [], [0.0]
    changes, significant = [], [np.zeros(grid.shape, dtype=bool)]
    for number, c in enumerate(cumulative):
        if number == 0 and c.plants is not None:
            of_first = np.nan_to_num(c.plants.error_from)
        plants.append(nothing if c.plants is None else np.nan_to_num(c.plants.error_to))
        without.append(np.sqrt(np.maximum(c.error**2 - plants[-1] ** 2 - of_first**2, 0.0)))
        shared.append(c.registration_error)
        usable = c.uniform_dz is None
        changes.append(np.where(usable, c.dz, np.nan))
        significant.append(c.significant & usable)
    own = own_variances(without, shared[1:], sampling[0], sampling[1:])
    start = np.where(np.isfinite(own[0]), 0.0, np.nan)
    first = gridded[0].epoch.date or date.min
    return Stack(
        days=np.array([((g.epoch.date or first) - first).days for g in gridded], dtype=np.float64),
        change=[start, *changes],
        variance=own,
        shared=shared,
        significant=significant,
        cell=grid.cell,
        plants=[of_first, *plants],
    )


def limits_of(analysis: Analysis, dates: tuple[date, ...], along: str | None = None) -> list[str]:
    """Sentences on the limits of the series.

    Args:
        along: what motion along the surface needs to be seen, where it was measured.
    """
    steps = [(b - a).days for a, b in pairwise(dates)]
    rates = [1000 * c.median_level / days for c, days in zip(analysis.incremental, steps, strict=True)]
    low, high = min(rates), max(rates)
    apart = f"{min(steps)}" if min(steps) == max(steps) else f"{min(steps)} to {max(steps)}"
    span = f"{low:.2g}" if f"{low:.2g}" == f"{high:.2g}" else f"{low:.2g} to {high:.2g}"
    seen = (
        f"Between two of these surveys, {apart} days apart, a cell must move by {span} mm/day to "
        "be seen: this screens trends, it is no alarm."
    )
    if along is not None:
        unseen = (
            f"{along} Movement between surveys, under ground that no pulse reached, or slower than that stays unseen; "
            "no change above the level of detection is no statement about stability."
        )
        return [seen, unseen]
    unseen = (
        "Movement between surveys, along the surface, under ground that no pulse reached, or slower than that stays "
        "unseen; no change above the level of detection is no statement about stability."
    )
    return [seen, unseen]
