"""More than two surveys on one grid: cumulative and stepwise change, zones through time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import GridChangeParameters, ZoneParameters
from ...interface.rates import rate_unit
from ...interface.rounding import significant_decimals
from ..change.result import Change
from ..core.progress import Progress
from ..grid.grid import Grid
from ..zones.change_zones import cells_of, detected_of
from ..zones.confidence import SureGroups, sure_groups
from ..zones.groups import label_groups
from ..zones.volumes import CorrelationModel
from .alerts import AlertLevel
from .bodies import with_bodies
from .comparisons import GriddedEpoch, compared
from .joined import cells_of as joined_cells
from .joined import joined_zones
from .judged import judged_zones
from .motion.windows import Layout
from .motion.zones import MovingGround
from .persistence import confirmed_cells
from .tracking import Track, track_zones
from .velocity import own_variances
from .visits import detectable_rates
from .zone_grounds import Ground, zone_grounds
from .zone_means import zone_means
from .zone_series import Stack, ZoneSeries, zone_series


@dataclass(frozen=True)
class Analysis:
    """Results of the gridded surveys. Changes have one entry a survey from the second on, read when it is asked for.

    ``confirmed`` (rows, columns) counts comparisons in a row that show a cell changed within a zone: a single cell that
    the first survey's noise lifted would stand out in all comparisons. ``correlations`` are those of the errors of each
    cumulative change.
    """

    cumulative: Sequence[Change]
    incremental: Sequence[Change]
    stack: Stack
    tracks: tuple[Track, ...]
    zones: tuple[ZoneSeries, ...]
    confirmed: NDArray[np.int64]
    unconfirmed: int
    correlations: tuple[CorrelationModel, ...]


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
    and gives no velocity. A zone begins with a group of cells that is sure (``confidence.sure_groups``).

    Args:
        folder: for the changes as long as the analysis is in use.
    """
    progress = progress or Progress()
    cumulative, incremental = compared(gridded, grid, parameters[0], folder, stable, progress)
    zone_parameters = parameters[1]
    groups, levels, correlations = [], [], []
    for number, change in enumerate(cumulative, 1):
        sure = _sure(change, zone_parameters)
        correlations.append(sure.correlation)
        groups.append((number, sure.labels, np.sign(np.nan_to_num(change.dz)).astype(np.int8)))
        levels.append(np.where(sure.labels > 0, change.level, np.inf))
    tracks = track_zones(groups, max(1, int(zone_parameters.bridged_gap / (2.0 * grid.cell) + 1e-6)))
    del groups
    living, stack = [t for t in tracks if not t.merged_into and len(t.footprint)], _stack(gridded, cumulative)
    grounds = zone_grounds(living, cumulative, zone_parameters.bridged_gap, [g.load for g in gridded], progress)
    means = zone_means(grounds, cumulative, correlations, zone_parameters.bridged_gap)
    found = [
        zone_series(track, of_zone, stack.days, alerts, minimum_area=zone_parameters.minimum_area)
        for track, of_zone in zip(living, means, strict=True)
    ]
    zones = with_bodies(judged_zones([z for z in found if z.confirmed.any()], stack.days, cumulative, alerts), grid)
    confirmed = confirmed_cells(stack.change[1:], levels)
    return Analysis(
        cumulative, incremental, stack, tracks, zones, confirmed, len(found) - len(zones), tuple(correlations)
    )


def _sure(change: Change, parameters: ZoneParameters) -> SureGroups:
    cells, found = cells_of(change), detected_of(change)
    labels = label_groups(
        change.dz, found.significant, parameters, change.partition, plants=cells.plants, sigma=change.error
    )
    count = int(labels.max(initial=0))
    return sure_groups(labels, count, cells, found, parameters, registration_error=change.registration_error)


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
    placed = [(one, cells) for one in ground if len(cells := joined_cells(one.windows, layout, grid))]
    if not placed:
        return analysis
    means = zone_means(
        [Ground(c) for _, c in placed], analysis.cumulative, analysis.correlations, parameters.bridged_gap
    )
    measured = [(one, of_one) for (one, _), of_one in zip(placed, means, strict=True)]
    days = analysis.stack.days
    zones = joined_zones(analysis.zones, measured, layout, grid, days, alerts)
    return replace(analysis, zones=with_bodies(judged_zones(zones, days, analysis.cumulative, alerts), grid))


def _stack(gridded: Sequence[GriddedEpoch], cumulative: Sequence[Change]) -> Stack:
    """The surveys of the cumulative changes, of which each is looked at once."""
    shape = cumulative[0].grid.shape
    of_first, plants, without, shared, changes, ratios = np.zeros(shape), [], [], [], [], []
    for number, c in enumerate(cumulative):
        if number == 0 and c.plants is not None:
            of_first = np.nan_to_num(c.plants.error_from)
        plants.append(0.0 if c.plants is None else np.nan_to_num(c.plants.error_to))
        without.append(np.sqrt(np.maximum(c.error**2 - plants[-1] ** 2 - of_first**2, 0.0)))
        shared.append(c.registration_error)
        changes.append(c.dz if c.uniform_dz is None else np.full(shape, np.nan))
        # the sampling variance goes with one over the number of points
        ratios.append(c.count_from / np.maximum(c.count_to, 1))
    own = own_variances(without, shared, np.ones(shape), ratios)
    start = np.where(np.isfinite(own[0]), 0.0, np.nan)
    first = gridded[0].epoch.date or date.min
    return Stack(
        days=np.array([((g.epoch.date or first) - first).days for g in gridded], dtype=np.float64),
        change=[start, *changes],
        variance=[variance + error**2 for variance, error in zip(own, [of_first, *plants], strict=True)],
    )


def limits_of(analysis: Analysis, dates: tuple[date, ...], along: str | None = None) -> list[str]:
    """Sentences on the limits of the series.

    Args:
        along: what motion along the surface needs to be seen, where it was measured.
    """
    steps, rates = detectable_rates(analysis.incremental, dates)
    low, high = min(rates), max(rates)
    apart = f"{min(steps)}" if min(steps) == max(steps) else f"{min(steps)} to {max(steps)}"
    unit = rate_unit(rates)
    first, last = (f"{rate:.{significant_decimals(rate)}f}" for rate in (unit.days * low, unit.days * high))
    span = first if first == last else f"{first} to {last}"
    seen = (
        f"Between two of these surveys, {apart} days apart, a cell must move by {span} {unit.name} to "
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
