"""Mean change and volume of each zone on its ground in each survey; errors hold what was not measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..change.result import Change
from ..core.arrays import Float, Index
from ..zones.change_zones import cells_of
from ..zones.footprints import Cells, in_window, plain_footprints
from ..zones.volumes import CorrelationModel
from .zone_grounds import Ground

_MIN_MEASURED_SHARE = 0.1  # of a zone's area: with less a survey did not measure it
_FLAT_DEVIATION = 3**-0.5  # standard deviation over mean of values that lie evenly between 0 and twice their mean


@dataclass(frozen=True)
class ZoneMeans:
    """What each survey measured on the ground of one zone. Arrays have one value a survey, the first included.

    Attributes:
        cells: flat indices of the zone's ground, the same in all surveys.
        area: of this ground on the map, m².
        change: mean change of all of it against the first survey, metres; NaN where a survey did not measure it.
        variance: each survey's own variance of ``change``, m².
        volume: m³; negative where the ground sank. On the map it is ``change`` times ``area``.
        volume_error: standard error of ``volume``, m³.
        measured: share of the ground that was measured in the survey and in the first one.
        lowered, raised: m² of significant change on this ground.
    """

    cells: Index
    area: float
    change: Float
    variance: Float
    volume: Float
    volume_error: Float
    measured: Float
    lowered: Float
    raised: Float


@dataclass(frozen=True)
class _Mean:
    """Of one survey. ``own`` and ``first`` are the variances of the mean that only this comparison has, and that the
    first survey gives to all, m².
    """

    change: float = math.nan
    own: float = math.nan
    first: float = math.nan
    size: float = math.nan
    measured: float = 0.0
    lowered: float = 0.0
    raised: float = 0.0


def zone_means(
    grounds: Sequence[Ground], changes: Iterable[Change], correlations: Sequence[CorrelationModel], gap: float
) -> list[ZoneMeans]:
    """What each survey measured on the ``grounds``.

    Where a ground has its own mean change, that counts. Its error is that of its points, and at least that of cells
    whose errors are as alike as on stable ground, where there was enough of it to know. Else the mean of the cells
    counts.

    Cells that were not measured, but have a measured one within ``gap``, are interpolated, with the scatter of the
    change in the error. For the rest of a ground the mean of the measured part is taken. Its error is the scatter of
    the change on that ground, and at least that of values spread evenly between 0 and twice the mean.

    Args:
        changes: of the surveys from the second on against the first; none is known if the whole overlap moved alike.
        correlations: of the errors of each.
    """
    surveys = []
    for survey, (change, model) in enumerate(zip(changes, correlations, strict=True), 1):
        cells = replace(cells_of(change), partition=change.partition)
        known = change.uniform_dz is None
        surveys.append([_mean(ground, survey, cells, (change, model), gap) if known else _Mean() for ground in grounds])
        side = change.grid.cell
    return [
        _together(ground.cells, [of_survey[number] for of_survey in surveys], side**2)
        for number, ground in enumerate(grounds)
    ]


def _together(ground: Index, means: Sequence[_Mean], cell_area: float) -> ZoneMeans:
    """Of the first survey, whose change is 0, the mean of what it gives to the comparisons is its own variance."""
    change, own, given, size, measured, lowered, raised = (
        np.array([first, *(getattr(mean, name) for mean in means)])
        for name, first in (
            ("change", 0.0), ("own", 0.0), ("first", 0.0), ("size", 0.0), ("measured", 1.0), ("lowered", 0.0),
            ("raised", 0.0),
        )
    )  # fmt: skip
    known = np.isfinite(change[1:])
    of_first = float(np.mean(given[1:][known])) if known.any() else math.nan
    variance = np.where(np.isfinite(change), np.maximum(own + given - of_first, 0.25 * (own + given)), np.nan)
    variance[0] = of_first
    return ZoneMeans(
        ground,
        len(ground) * cell_area,
        change,
        variance,
        volume=change * size,
        volume_error=np.sqrt(own + given) * size,
        measured=measured,
        lowered=lowered,
        raised=raised,
    )


def _mean(ground: Ground, survey: int, whole: Cells, compared: tuple[Change, CorrelationModel], gap: float) -> _Mean:
    change, model = compared
    row, column = np.divmod(ground.cells, change.grid.columns)
    margin = max(1, round(gap / whole.cell)) + max(5, round(1.0 / whole.cell))
    window = (
        slice(max(0, int(row.min()) - margin), min(change.grid.rows, int(row.max()) + margin + 1)),
        slice(max(0, int(column.min()) - margin), min(change.grid.columns, int(column.max()) + margin + 1)),
    )
    near = in_window(whole, window)
    labels = np.zeros(near.dz.shape, dtype=np.int32)
    labels[row - window[0].start, column - window[1].start] = 1
    footprint = plain_footprints(near, labels, 1, gap=gap)[0]
    within = tuple(
        slice(outer.start + inner.start, outer.start + min(inner.stop, outer.stop - outer.start))
        for outer, inner in zip(window, footprint.window, strict=True)
    )
    cells, weights = in_window(whole, within), footprint.weights
    covered = float(weights.sum())
    # on the slope, where the change is square to it
    steep = float(np.mean(cells.area[footprint.own])) / change.grid.cell**2 if footprint.own.any() else 1.0
    size = len(ground.cells) * change.grid.cell**2 * steep
    if footprint.measured < _MIN_MEASURED_SHARE or covered < _MIN_MEASURED_SHARE * size:
        return _Mean()
    dz, share = np.nan_to_num(cells.dz), weights / covered
    mean = float(np.sum(share * dz))
    scatter = math.sqrt(float(np.sum(share * (dz - mean) ** 2)))
    unseen = max(0.0, 1.0 - covered / size) * max(scatter, _FLAT_DEVIATION * abs(mean))
    counts = [a[within][footprint.own].astype(np.float64) for a in (change.count_from, change.count_to)]
    of_first = float(np.mean(counts[1] / np.maximum(counts[0] + counts[1], 1.0)))
    sampling = model.own_error(share, cells) ** 2
    interpolated = footprint.scatter / covered
    if ground.change is not None and ground.variance is not None:
        mean, by_points = float(ground.change[survey]) / steep, float(ground.variance[survey]) / steep**2
        sampling, interpolated = by_points if model.variogram is None else max(sampling, by_points), 0.0
    plants = (0.0, 0.0)
    if change.plants is not None:
        errors = (change.plants.error_from, change.plants.error_to)
        before, after = (float(np.sum(share * np.nan_to_num(e[within]))) for e in errors)
        plants = before, after
    own = (1.0 - of_first) * sampling + plants[1] ** 2 + model.registration_error**2
    significant = change.significant[within] & (footprint.inside)
    return _Mean(
        mean,
        own + unseen**2 + interpolated**2,
        of_first * sampling + plants[0] ** 2,
        size,
        min(1.0, footprint.measured),
        float(np.count_nonzero(significant & (dz < 0))) * change.grid.cell**2,
        float(np.count_nonzero(significant & (dz > 0))) * change.grid.cell**2,
    )
