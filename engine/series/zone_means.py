"""The ground of a zone, and its mean change and volume there in each survey; errors hold what was not measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ..change.result import Change
from ..core.arrays import Bool, Float, Index
from ..zones.change_zones import cells_of
from ..zones.footprints import Cells, Footprint, in_window, outline_footprints, plain_footprints
from ..zones.volumes import CorrelationModel
from .tracking import Track

_MIN_MEASURED_SHARE = 0.1  # of a zone's area: with less a survey did not measure it
_MIDDLE_SHARE = 0.25  # of a zone's measured cells, the innermost: their mean change is that of its middle
_RINGS_A_CELL = 2
_LEAST_SHARE = 0.1  # of the change in the middle: ground that moved by less is not the zone's
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


def zone_grounds(tracks: Sequence[Track], changes: Sequence[Change], gap: float) -> list[Index]:
    """The cells (flat indices) of each zone's ground: its footprint as of a change between two surveys.

    Of the surveys that saw the zone, that in which its volume is largest gives the footprint
    (``footprints.outline_footprints``). The zone's cells in all other surveys belong to it as well.

    Args:
        changes: of the surveys from the second on against the first.
        gap: metres, see ``outline_footprints``.
    """
    found, largest = [track.footprint for track in tracks], np.zeros(len(tracks))
    seen = [{s.epoch for s in track.sightings} for track in tracks]
    for survey, change in enumerate(changes, 1):
        if not any(survey in epochs for epochs in seen):
            continue
        labels = np.zeros(change.grid.shape, dtype=np.int32)
        for number, track in enumerate(tracks, 1):
            labels.ravel()[track.footprint] = number
        number_of = np.unique(labels[labels > 0])
        cells, outlines = cells_of(change), labels.copy()
        outlines[labels > 0] = np.searchsorted(number_of, labels[labels > 0]) + 1
        footprints = outline_footprints(
            cells, outlines, len(number_of), gap=gap, registration_error=change.registration_error
        )
        for number, footprint in zip((number_of - 1).tolist(), footprints, strict=True):
            near = in_window(cells, footprint.window)
            volume = abs(float(np.sum(footprint.weights * np.nan_to_num(near.dz))))
            if survey in seen[number] and volume > largest[number]:
                largest[number] = volume
                row, column = np.nonzero(_moved(near, labels[footprint.window] == number + 1, footprint))
                found[number] = (row + footprint.window[0].start) * change.grid.columns + column
                found[number] += footprint.window[1].start
    return found


def _moved(cells: Cells, own: Bool, footprint: Footprint) -> Bool:
    """The footprint without its rim of ground that hardly moved.

    Ring by ring from the inside, up to the ring whose mean change is less than a share of that in the middle. Means of
    whole rings decide, so that noise does not choose single cells.

    Args:
        cells, own: change in the footprint's window, and the cells (rows, columns) of the zone.
    """
    known = np.isfinite(cells.dz) & footprint.inside
    depth = ndimage.distance_transform_edt(own) - ndimage.distance_transform_edt(~own)
    ring = np.ceil(_RINGS_A_CELL * (depth.max() - depth)).astype(np.int64)
    inside = np.where(known, ring, 0)
    number = np.bincount(inside[known])
    total = np.bincount(inside[known], cells.dz[known], minlength=len(number))
    reached = np.cumsum(number)
    middle = int(np.searchsorted(reached, _MIDDLE_SHARE * int(np.count_nonzero(own & known))))
    least = _LEAST_SHARE * float(total[: middle + 1].sum()) / max(int(reached[middle]), 1)
    weak = np.flatnonzero((np.sign(least) * total < abs(least) * number) & (np.arange(len(number)) > middle))
    filled: Bool = footprint.inside & (ring < (int(weak[0]) if weak.size else len(number) + 1))
    return filled


def zone_means(
    grounds: Sequence[Index], changes: Iterable[Change], correlations: Sequence[CorrelationModel], gap: float
) -> list[ZoneMeans]:
    """What each survey measured on the ``grounds`` (flat indices each).

    Cells that were not measured, but have a measured one within ``gap``, are interpolated, with the scatter of the
    change in the error. For the rest of a ground the mean of the measured part is taken. Its error is the scatter of
    the change on that ground, and at least that of values spread evenly between 0 and twice the mean.

    Args:
        changes: of the surveys from the second on against the first; none is known if the whole overlap moved alike.
        correlations: of the errors of each.
    """
    surveys = []
    for change, model in zip(changes, correlations, strict=True):
        cells = replace(cells_of(change), partition=change.partition)
        known = change.uniform_dz is None
        surveys.append([_mean(ground, change, cells, model, gap) if known else _Mean() for ground in grounds])
        side = change.grid.cell
    return [
        _together(ground, [of_survey[number] for of_survey in surveys], side**2)
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


def _mean(ground: Index, change: Change, whole: Cells, model: CorrelationModel, gap: float) -> _Mean:
    row, column = np.divmod(ground, change.grid.columns)
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
    size = len(ground) * change.grid.cell**2 * steep
    if footprint.measured < _MIN_MEASURED_SHARE or covered < _MIN_MEASURED_SHARE * size:
        return _Mean()
    dz, share = np.nan_to_num(cells.dz), weights / covered
    mean = float(np.sum(share * dz))
    scatter = math.sqrt(float(np.sum(share * (dz - mean) ** 2)))
    unseen = max(0.0, 1.0 - covered / size) * max(scatter, _FLAT_DEVIATION * abs(mean))
    counts = [a[within][footprint.own].astype(np.float64) for a in (change.count_from, change.count_to)]
    of_first = float(np.mean(counts[1] / np.maximum(counts[0] + counts[1], 1.0)))
    sampling = model.own_error(share, cells) ** 2
    plants = (0.0, 0.0)
    if change.plants is not None:
        errors = (change.plants.error_from, change.plants.error_to)
        before, after = (float(np.sum(share * np.nan_to_num(e[within]))) for e in errors)
        plants = before, after
    own = (1.0 - of_first) * sampling + plants[1] ** 2 + model.registration_error**2
    significant = change.significant[within] & (footprint.inside)
    return _Mean(
        mean,
        own + unseen**2 + (footprint.scatter / covered) ** 2,
        of_first * sampling + plants[0] ** 2,
        size,
        min(1.0, footprint.measured),
        float(np.count_nonzero(significant & (dz < 0))) * change.grid.cell**2,
        float(np.count_nonzero(significant & (dz > 0))) * change.grid.cell**2,
    )
