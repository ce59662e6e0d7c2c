"""More than two surveys on one grid: cumulative and stepwise change, zones through time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import GridChangeParameters, ZoneParameters
from ..change.difference import Areas, difference_of_cells
from ..change.doubts import warn_of_doubtful_change
from ..change.result import Change
from ..core.errors import InputError
from ..core.named_progress import NamedProgress
from ..core.progress import Progress
from ..epochs.epoch import Epoch
from ..geometry.rigid_transform import RigidTransform
from ..grid.cell_statistics import CellStatistics
from ..grid.grid import Grid
from ..grid.pooled_variance import pooled_variance
from ..zones.groups import label_groups
from .alerts import AlertLevel
from .persistence import confirmed_cells
from .tracking import Track, track_zones
from .velocity import own_variances
from .zone_series import Stack, ZoneSeries, zone_series


@dataclass(frozen=True)
class GriddedEpoch:
    """A survey in the frame and on the grid of the first one.

    ``registration_error`` is the standard error of a height (m), 0 for the first; ``area`` the part of the region of
    interest that both it and the first survey hold. ``facts`` state what was done, and ``made`` which steps were not
    reused (ground, registration, cells).
    """

    epoch: Epoch
    transform: RigidTransform
    registration_error: float
    cells: CellStatistics
    area: BaseGeometry | None
    facts: dict[str, Any]
    made: tuple[str, ...]


@dataclass(frozen=True)
class Analysis:
    """Results of the gridded surveys. Changes have one entry a survey from the second on.

    ``confirmed`` (rows, columns) counts comparisons in a row that show a cell changed within a group of at least the
    least area: a single cell that the first survey's noise lifted would stand out in all comparisons.
    """

    cumulative: list[Change]
    incremental: list[Change]
    stack: Stack
    tracks: tuple[Track, ...]
    zones: tuple[ZoneSeries, ...]
    confirmed: NDArray[np.int64]
    unconfirmed: int


def analyse(
    gridded: Sequence[GriddedEpoch],
    grid: Grid,
    parameters: GridChangeParameters,
    zone_parameters: ZoneParameters,
    alerts: tuple[AlertLevel, ...],
    *,
    stable: BaseGeometry | None = None,
    progress: Progress | None = None,
) -> Analysis:
    """Differences, zones and their series of surveys that are on one grid; the first one's own transform is none.

    A survey whose whole overlap rose or sank alike (a datum or bias, see ``difference.uniform_shift``) makes no zones
    and gives no velocity.
    """
    progress = progress or Progress()
    names = [g.epoch.name for g in gridded]
    shares = [NamedProgress(s, n) for s, n in zip(progress.split(names), names, strict=True)]
    first = gridded[0]
    cumulative, incremental = [], []
    for number, (before, later) in enumerate(pairwise(gridded), 1):
        progress.update(number / len(gridded), f"comparing {later.epoch.name}")
        try:
            cumulative.append(_difference(first, later, grid, parameters, stable))
            # all along the direction of the first comparison
            parameters = replace(parameters, direction=cumulative[0].direction)
            incremental.append(cumulative[0] if number == 1 else _difference(before, later, grid, parameters, stable))
        except InputError as wrong:
            raise InputError(f"{later.epoch.name}: {wrong}") from wrong
        warn_of_doubtful_change(cumulative[-1], shares[number], may_grow=False)
    stack = _stack(gridded, cumulative, grid)
    reach = int(zone_parameters.bridged_gap / (2.0 * grid.cell) + 1e-6)
    groups = []
    for number, change in enumerate(cumulative, 1):
        plants = None if change.plants is None else change.plants.error
        labels = label_groups(change.dz, stack.significant[number], zone_parameters, change.partition, plants=plants)
        groups.append((number, labels, np.sign(np.nan_to_num(change.dz)).astype(np.int8)))
    tracks = track_zones(groups, max(1, reach))
    living = [t for t in tracks if not t.merged_into and len(t.footprint)]
    found = zone_series(living, stack, alerts, minimum_area=zone_parameters.minimum_area, bridged=max(2, 2 * reach))
    zones = tuple(z for z in found if z.epochs_confirmed > 0)
    grouped = [np.where(labels > 0, c.level, np.inf) for (_, labels, _), c in zip(groups, cumulative, strict=True)]
    confirmed = confirmed_cells([c.dz for c in cumulative], grouped)
    return Analysis(cumulative, incremental, stack, tracks, zones, confirmed, len(found) - len(zones))


def _difference(
    a: GriddedEpoch, b: GriddedEpoch, grid: Grid, parameters: GridChangeParameters, stable: BaseGeometry | None
) -> Change:
    area = a.area if b.area is None else b.area if a.area is None else a.area.intersection(b.area)
    error = float(np.hypot(a.registration_error, b.registration_error))
    return difference_of_cells(a.cells, b.cells, grid, parameters, error, Areas(area, stable))


def _stack(gridded: Sequence[GriddedEpoch], cumulative: Sequence[Change], grid: Grid) -> Stack:
    sampling = [g.cells.on_grid(g.cells.leverage * pooled_variance(g.cells)) for g in gridded]
    usable = [c.uniform_dz is None for c in cumulative]
    shared = [0.0, *(c.registration_error for c in cumulative)]
    nothing = np.zeros(grid.shape)
    plants = [nothing if c.plants is None else np.nan_to_num(c.plants.error_to) for c in cumulative]
    of_first = nothing if cumulative[0].plants is None else np.nan_to_num(cumulative[0].plants.error_from)
    without = [
        np.sqrt(np.maximum(c.error**2 - p**2 - of_first**2, 0.0)) for c, p in zip(cumulative, plants, strict=True)
    ]
    own = own_variances(without, shared[1:], sampling[0], sampling[1:])
    start = np.where(np.isfinite(own[0]), 0.0, np.nan)
    first = gridded[0].epoch.date or date.min
    return Stack(
        days=np.array([((g.epoch.date or first) - first).days for g in gridded], dtype=np.float64),
        change=[start, *(np.where(ok, c.dz, np.nan) for ok, c in zip(usable, cumulative, strict=True))],
        variance=own,
        shared=shared,
        significant=[
            np.zeros(grid.shape, dtype=bool),
            *(c.significant & ok for ok, c in zip(usable, cumulative, strict=True)),
        ],
        cell=grid.cell,
        plants=[of_first, *plants],
    )


def limits_of(analysis: Analysis, dates: tuple[date, ...]) -> list[str]:
    """Sentences on the limits of the series."""
    steps = [(b - a).days for a, b in pairwise(dates)]
    rates = [1000 * c.median_level / days for c, days in zip(analysis.incremental, steps, strict=True)]
    low, high = min(rates), max(rates)
    apart = f"{min(steps)}" if min(steps) == max(steps) else f"{min(steps)} to {max(steps)}"
    span = f"{low:.2g}" if f"{low:.2g}" == f"{high:.2g}" else f"{low:.2g} to {high:.2g}"
    seen = (
        f"Between two of these surveys, {apart} days apart, a cell must move by {span} mm/day to "
        "be seen: this screens trends, it is no alarm."
    )
    unseen = (
        "Movement between surveys, along the surface, under ground that no pulse reached, or slower than that stays "
        "unseen; no change above the level of detection is no statement about stability."
    )
    return [seen, unseen]
