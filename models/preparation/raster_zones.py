"""Zones of a score raster: groups of connected cells beyond a level, and the level for a number of false ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ...engine.core.arrays import Bool, Float

MIN_AREA_M2 = 1.0
PER_M2 = 1000.0
"""False zones are counted on so many m²."""
LEVELS = 72
_TAIL_SHARE = 0.85
"""Levels begin where this share of the cells is below."""
_MIN_TAIL_ZONES = 3.0
_MAX_TAIL_ZONES = 12.0
"""Counts between which the tail is fitted."""
_EIGHT = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True)
class Scores:
    """How much each cell (columns, rows) looks like uplift and like subsidence; NaN without data. ``cell`` in m. Zones
    reach as far as the score is above ``outline``, where that is lower than the level that they must pass.
    """

    uplift: NDArray[np.floating]
    subsidence: NDArray[np.floating]
    cell: float
    outline: float = np.inf

    @classmethod
    def signed(cls, score: NDArray[np.floating], cell: float, outline: float = np.inf) -> Scores:
        """Of a score that is positive on uplift and negative on subsidence."""
        return cls(score, -score, cell, outline)

    @classmethod
    def strongest(cls, signed: Sequence[NDArray[np.floating]], cell: float) -> Scores:
        """For either sign the largest of several signed scores (columns, rows); NaN where none has data."""
        stack = np.stack(list(signed))
        missing = np.isnan(stack).all(axis=0)
        up, down = (np.nan_to_num(sign * stack, nan=-np.inf).max(axis=0) for sign in (1.0, -1.0))
        return cls(np.where(missing, np.nan, up), np.where(missing, np.nan, down), cell)

    @property
    def area(self) -> float:
        """Area with data, m²."""
        return float(np.count_nonzero(np.isfinite(self.uplift))) * self.cell**2


def zones_above(
    score: NDArray[np.floating], level: float, cell: float, outline: float = np.inf
) -> tuple[NDArray[np.int32], int]:
    """Zones (columns, rows), numbered from 1, and their number: connected cells (eight neighbours) above ``level`` with
    at least ``MIN_AREA_M2``; 0 elsewhere.

    With an ``outline`` below the level a zone is connected cells above that, of which at least ``MIN_AREA_M2`` are
    above the level (hysteresis, Canny 1986, doi:10.1109/TPAMI.1986.4767851, section on streaking).
    """
    groups, count = label(score > min(level, outline), _EIGHT)
    kept = np.bincount(groups[score > level], minlength=count + 1) * cell**2 >= MIN_AREA_M2 - 1e-9
    kept[0] = False
    number = np.where(kept, np.cumsum(kept), 0).astype(np.int32)
    return number[groups], int(kept.sum())


def zone_counts(scores: Scores, levels: Float) -> Float:
    """(k,) zones of both signs above each of ``levels`` (k,)."""
    return np.array(
        [
            sum(
                zones_above(score, level, scores.cell, scores.outline)[1]
                for score in (scores.uplift, scores.subsidence)
            )
            for level in levels
        ],
        dtype=np.float64,
    )


def common_levels(grounds: Sequence[Scores]) -> Float:
    """(LEVELS,) rising levels through the upper tail of the scores, denser where there are fewer cells."""
    values = np.concatenate(
        [score[np.isfinite(score)] for one in grounds for score in (one.uplift, one.subsidence)] or [np.zeros(1)]
    )
    tail = np.geomspace(1.0 - _TAIL_SHARE, 0.5 / len(values), LEVELS - 1)
    top = float(values.max())
    return np.append(np.quantile(values, 1.0 - tail), top + 1e-6 * (abs(top) + 1.0))


def level_for_rate(levels: Float, rates: Float, area: float, wanted: float = 1.0) -> float:
    """The lowest level above which there are never more than ``wanted`` zones per 1,000 m².

    Where the ground is too small to show as few as that (less than three zones are expected on it), the level is read
    from an exponential tail of the rate over the level through counts of 3 to 12 zones: heavier than that of normal
    scores, as relief has it (peaks over a threshold, Pickands 1975, doi:10.1214/aos/1176343003).

    Args:
        levels: (k,) rising. rates: (k,) zones per 1,000 m² above each. area: on which they were counted, m².
    """
    if wanted * area / PER_M2 < _MIN_TAIL_ZONES:
        return _level_in_tail(levels, rates, area, wanted)
    over = np.flatnonzero(rates > wanted)
    if not len(over):
        return float(levels[0])
    last = int(over[-1])
    if last == len(levels) - 1:
        return float(levels[-1])
    low, high = rates[last], rates[last + 1]
    share = (low - wanted) / (low - high)
    return float(levels[last] + share * (levels[last + 1] - levels[last]))


def conformal_level(levels: Float, rates: Float, wanted: float, cap: float) -> float:
    """The lowest level that conformal risk control accepts for ``wanted`` false zones per 1,000 m² (Angelopoulos et
    al., arXiv 2208.02814, equation 4; for segmentation arXiv 2504.07611); NaN where there are too few slopes for any.

    On a further slope, drawn like those given, the expected number of false zones per 1,000 m², counted up to ``cap``,
    is at most ``wanted``. Slopes of one survey are alike, so that this holds less well for a slope of another.

    Args:
        levels: (k,) rising. rates: (slopes, k) zones per 1,000 m² above each level on untouched ground. They are taken
            as the most above that level or any higher one, since zones grow together at low levels.
    """
    most = np.maximum.accumulate(rates[:, ::-1], axis=1)[:, ::-1]
    bound = (np.minimum(most, cap).sum(axis=0) + cap) / (len(rates) + 1)
    accepted = np.flatnonzero(bound <= wanted)
    return float(levels[accepted[0]]) if len(accepted) else float("nan")


def level_between(levels: Mapping[float, float], false_zones: float) -> float:
    """The level for accepted false zones per 1,000 m² from a table of both: linear in their logarithm between its rows,
    that of the nearest row beyond them.
    """
    return float(np.interp(np.log(false_zones), np.log(list(levels)), list(levels.values())))


def _level_in_tail(levels: Float, rates: Float, area: float, wanted: float) -> float:
    counts = rates * area / PER_M2
    peak = int(counts.argmax())  # below it zones run into one another
    use = np.flatnonzero((counts >= _MIN_TAIL_ZONES) & (counts <= _MAX_TAIL_ZONES))
    use = use[use >= peak]
    if len(use) < 3 or counts[use[0]] <= counts[use[-1]]:
        return float(levels[-1])
    slope, start = np.polyfit(levels[use], np.log(rates[use]), 1)
    return float(max((np.log(wanted) - start) / slope, levels[use[0]]))


def strength_at(score: NDArray[np.floating], footprint: Bool, cell: float, outline: float = np.inf) -> float:
    """The highest level at which a zone overlaps a quarter of ``footprint`` (columns, rows) or 1 m² of it; -inf where
    none does at any level. ``outline`` is that of ``zones_above``.

    It is found with that level as threshold, and with any lower one.
    """
    i, j = np.nonzero(footprint)
    if not len(i):
        return -np.inf
    grown = _grown_strength(score, footprint, cell, outline)
    if grown > outline:
        return grown
    margin = round(3.0 / cell)
    part = np.s_[max(i.min() - margin, 0) : i.max() + margin + 1, max(j.min() - margin, 0) : j.max() + margin + 1]
    near, inside = score[part], footprint[part]
    need = min(MIN_AREA_M2, 0.25 * len(i) * cell**2)
    candidates = np.unique(near[np.isfinite(near)])[::-1]
    low, high = 0, len(candidates)  # the first candidate at which it is found, by bisection
    while low < high:
        middle = (low + high) // 2
        zones, count = zones_above(near, np.nextafter(candidates[middle], -np.inf), cell)
        overlap = np.bincount(zones[inside], minlength=count + 1)[1:] * cell**2
        if count and overlap.max() >= need - 1e-9:
            high = middle
        else:
            low = middle + 1
    return float(candidates[low]) if low < len(candidates) else -np.inf


def _grown_strength(score: NDArray[np.floating], footprint: Bool, cell: float, outline: float) -> float:
    """``strength_at`` among levels above the ``outline``; -inf where that is not passed."""
    zones, count = zones_above(score, outline, cell)
    overlap = np.bincount(zones[footprint], minlength=count + 1) * cell**2
    need = min(MIN_AREA_M2, 0.25 * np.count_nonzero(footprint) * cell**2)
    least = int(np.ceil(MIN_AREA_M2 / cell**2 - 1e-9))
    mine = np.flatnonzero(overlap[1:] >= need - 1e-9) + 1
    return max((float(np.sort(score[zones == zone])[-least]) for zone in mine), default=-np.inf)
