"""What surveys of one slope at several times of the year say of the season: how much ground each of them saw."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np

from ..core.arrays import Bool, Float, Index
from ..grid.grid import Grid, cell_index
from .terrain import Terrain

MIN_RATIO = 1.1
"""Of the ground shares of two months, below which they are called alike."""
MIN_ERRORS = 2.0
"""Standard errors by which they must differ as well."""
BLOCK_PLACES = 5
"""Places along the side of a block: plants next to one another are alike, so that blocks, not places, are counted."""
_MIN_BLOCKS = 4
MIN_STRIP_COUNT = 100
"""Places with pulses of two strips, and ground returns of each of them there, from which on the strips are compared."""
_HIGH_PERCENTILE = 95.0


@dataclass(frozen=True)
class Counted:
    """A survey over the places of a grid (rows, columns): ``pulses`` and returns of the ``ground``, and how far its
    plants reach above the ground, ``plants`` metres (the 95th percentile of all first returns that are not ground; 0
    where there are none). ``strips`` are pulses and ground of each of its flight strips.
    """

    day: date
    pulses: Index
    ground: Index
    plants: float
    strips: tuple[tuple[Index, Index], ...] = ()


@dataclass(frozen=True)
class SeasonOfSurvey:
    """One survey in figures, over the places that all surveys have pulses in.

    ``pulses`` and ``ground`` returns a m² of map, ``share`` of the pulses that reached the ground, ``without_ground``
    the share of the area whose pulses all missed it, ``plants`` as of ``Counted``.
    """

    day: date
    pulses: float
    ground: float
    share: float
    without_ground: float
    plants: float


@dataclass(frozen=True)
class Season:
    """What the surveys say together.

    Attributes:
        surveys: in the order of their days.
        months: mean share of the pulses that reached the ground, by the months (1 to 12) of which there are surveys.
        best, worst: the months with the most and the least ground; None where nothing can be said.
        also: months whose share is so near to that of the best one that they serve as well.
        ratio: of the shares of best and worst; ``error`` is the standard error of their difference.
        reason: empty, or why no month is named: ``one survey``, ``one month``, ``alike``, ``small`` (too few places
            in common to tell), or ``strips`` (strips of one survey differ as much as the months).
        area: of the places in common, m².
        strip_ratio: see ``ratio_of_strips``, the largest of the surveys; NaN where no survey has strips that compare.
    """

    surveys: tuple[SeasonOfSurvey, ...]
    months: dict[int, float]
    best: int | None
    worst: int | None
    also: tuple[int, ...]
    ratio: float
    error: float
    reason: str
    area: float
    strip_ratio: float = math.nan


def counted(
    day: date, grid: Grid, first: Float, ground: Float, plants: Float | None, terrain: Terrain, region: Bool
) -> Counted:
    """A survey of ``day`` over the places of ``grid``.

    Args:
        first: (n, 3) its first returns, one a pulse.
        ground: (m, 3) its ground returns.
        plants: (k, 3) its first returns that are not of the ground; None: no heights are wanted.
        terrain: of its own ground, above which plants are measured, so that a shift between surveys does no harm.
        region: (rows, columns) places that count.
    """
    height = 0.0
    if plants is not None and len(plants):
        place = cell_index(plants, grid)
        inside = (place >= 0) & region.ravel()[np.maximum(place, 0)]
        above = plants[inside, 2] - terrain.at(plants[inside, :2])
        above = above[np.isfinite(above)]
        height = float(np.percentile(above, _HIGH_PERCENTILE)) if above.size else 0.0
    return Counted(day, _counts(first, grid), _counts(ground, grid), max(height, 0.0))


def strip_counts(
    grid: Grid, first: Float, ground: Float, of_first: Index, of_ground: Index
) -> tuple[tuple[Index, Index], ...]:
    """Pulses and ground returns of each flight strip over the places of ``grid``, by the numbers of the strips of the
    first returns (n, 3) and the ground (m, 3).
    """
    return tuple(
        (_counts(first[of_first == number], grid), _counts(ground[of_ground == number], grid))
        for number in np.unique(of_first)
    )


def ratio_of_strips(survey: Counted, region: Bool) -> float:
    """How many times more ground one strip of a survey sees than another: the ratio of the shares of their pulses that
    reached the ground, at the places of ``region`` (rows, columns) that both saw, the median over all pairs of strips;
    NaN where none compares. They were flown on one day, so this is what the way of a flight makes, not the season.
    """
    found = []
    for (pulses, ground), (others, other_ground) in itertools.combinations(survey.strips, 2):
        both = region & (pulses > 0) & (others > 0)
        counts = float(ground[both].sum()), float(other_ground[both].sum())
        if both.sum() >= MIN_STRIP_COUNT and min(counts) >= MIN_STRIP_COUNT:
            low, high = sorted((counts[0] / pulses[both].sum(), counts[1] / others[both].sum()))
            found.append(high / low)
    return float(np.median(found)) if found else math.nan


def season_of(surveys: Sequence[Counted], grid: Grid, region: Bool) -> Season:
    """Compare surveys over the places of ``region`` (rows, columns) that all of them have pulses in.

    The share of pulses that reach the ground does not depend on how many there are, so surveys of other densities
    compare. Months are compared, as several surveys may be of one; two months differ where their shares do by 10 % and
    by two standard errors of their difference, which is taken over blocks of five by five places, and by more than
    strips of one survey do.
    """
    ordered = sorted(surveys, key=lambda s: s.day)
    common = region & np.logical_and.reduce([s.pulses > 0 for s in ordered])
    found = tuple(_figures(s, common, grid) for s in ordered)
    by_month: dict[int, list[int]] = {}
    for number, survey in enumerate(ordered):
        by_month.setdefault(survey.day.month, []).append(number)
    months = {month: float(np.mean([found[n].share for n in by_month[month]])) for month in sorted(by_month)}
    best = max(months, key=lambda month: (months[month], -month))
    worst = min(months, key=lambda month: (months[month], month))
    reason, ratio, error = "", math.nan, math.nan
    if not common.any():
        reason = "small"
    elif len(months) < 2:
        reason = "one survey" if len(ordered) == 1 else "one month"
    else:
        error = _error_of_difference(ordered, by_month[best], by_month[worst], common)
        ratio = months[best] / months[worst] if months[worst] > 0 else math.inf
        if not math.isfinite(error):
            reason = "small"
        elif ratio < MIN_RATIO or months[best] - months[worst] <= MIN_ERRORS * error:
            reason = "alike"
    strips = np.array([ratio_of_strips(s, region) for s in ordered])
    strip_ratio = float(np.nanmax(strips)) if np.isfinite(strips).any() else math.nan
    if not reason and ratio <= strip_ratio:
        reason = "strips"
    also = () if reason else tuple(m for m in months if m != best and MIN_RATIO * months[m] > months[best])
    area = float(common.sum()) * grid.cell**2
    return Season(found, months, None if reason else best, None if reason else worst, also, ratio, error, reason, area,
                  strip_ratio)  # fmt: skip


def _figures(survey: Counted, common: Bool, grid: Grid) -> SeasonOfSurvey:
    pulses, ground = survey.pulses[common].sum(), survey.ground[common].sum()
    area = max(float(common.sum()) * grid.cell**2, 1e-9)
    return SeasonOfSurvey(
        survey.day,
        float(pulses) / area,
        float(ground) / area,
        float(ground) / max(float(pulses), 1.0),
        float((survey.ground[common] == 0).mean()) if common.any() else math.nan,
        survey.plants,
    )


def _error_of_difference(surveys: Sequence[Counted], some: Sequence[int], others: Sequence[int], common: Bool) -> float:
    """Standard error of the difference of two months' mean shares, by leaving out one block after the other
    (jackknife); NaN where there are fewer than four blocks.
    """
    rows, columns = np.nonzero(common)
    block = (rows // BLOCK_PLACES) * (common.shape[1] // BLOCK_PLACES + 1) + columns // BLOCK_PLACES
    _, block = np.unique(block, return_inverse=True)
    count = int(block.max()) + 1
    if count < _MIN_BLOCKS:
        return math.nan
    left = np.zeros(count)
    for sign, numbers in ((1.0, some), (-1.0, others)):
        for number in numbers:
            pulses, ground = (np.bincount(block, a[common], count) for a in _both(surveys[number]))
            rest = np.maximum(pulses.sum() - pulses, 1.0)
            left += sign / len(numbers) * (ground.sum() - ground) / rest
    return float(np.sqrt((count - 1) / count * np.sum((left - left.mean()) ** 2)))


def _both(survey: Counted) -> tuple[Index, Index]:
    return survey.pulses, survey.ground


def _counts(points: Float, grid: Grid) -> Index:
    place = cell_index(points, grid)
    return np.bincount(place[place >= 0], minlength=grid.rows * grid.columns).reshape(grid.shape)
