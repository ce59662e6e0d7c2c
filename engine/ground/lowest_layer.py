"""Where in the lowest layer of returns the ground lies: a closed plant cover has no gap that would show it.

Of a pulse into grass little reaches the ground, and the layer is densest in the grass. So the ground is not looked for
where returns are many but where they end: below the ground there is only the noise of the range. Points below a height
lie below it by 0.8 sigma on average (mean of a half normal distribution) if that height is the ground; if it is in the
plants, the points below it are spread wider. The lowest height at which the depth is reached is taken. On bare ground,
where returns lie on both sides alike, it is their median.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Bool, Float, Index
from ..core.compiled import compiled

BIN_M = 0.005
LOWEST_M, HIGHEST_M = -0.3, 0.7
BINS = round((HIGHEST_M - LOWEST_M) / BIN_M)
HALF_NORMAL_MEAN = 0.798
MIN_BELOW_POINTS, MIN_BELOW_SHARE = 1.5, 0.004
"""Points that must lie below the ground for it to be believed: at least, and of all returns."""
SMOOTHING_M, PEAK_WITHIN_M, VALLEY_WITHIN_M, VALLEY = 0.02, 0.1, 0.15, 0.35
"""Of a separate lowest layer: smoothing of the density, distance of its peak from the ground, and where it must fall to
what share of it."""
MIN_LAYER_POINTS = 45.0
MAX_BELOW_SIGMAS = 4.0
"""Times sigma: returns deeper below the ground are no evidence for it."""
EDGES: Float = LOWEST_M + BIN_M * np.arange(BINS + 1, dtype=np.float64)
_MIDDLES: Float = LOWEST_M + BIN_M * (np.arange(BINS, dtype=np.float64) + 0.5)


@dataclass(frozen=True)
class Layers:
    """The lowest layer of windows; arrays of the windows' shape, metres above the surface that heights refer to.

    ``ground`` is the height of the ground, NaN where too few returns are known; ``top`` the height up to which returns
    are taken for ground, so that their mean is the ground; ``taken`` counts returns between the lowest and ``top``,
    ``returns`` all of them; ``median`` is the height of half of the returns over the ground.
    """

    ground: Float
    top: Float
    taken: Float
    returns: Float
    median: Float

    def where(self, chosen: Bool, other: Layers) -> Layers:
        """These layers, with ``other``'s (m,) in the m windows ``chosen``."""
        values = {}
        for name in (f.name for f in fields(self)):
            values[name] = getattr(self, name).copy()
            values[name][chosen] = getattr(other, name)
        return Layers(**values)


def histograms(height: Float, window: NDArray[np.int64], count: int) -> Float:
    """(count, BINS) returns by height; ``window`` (n,) is each return's; heights beyond the range are left out."""
    bins = np.floor((height - LOWEST_M) / BIN_M).astype(np.int64)
    inside = (bins >= 0) & (bins < BINS)
    found = np.bincount(window[inside] * BINS + bins[inside], minlength=count * BINS)
    return np.asarray(found, dtype=np.float64).reshape(count, BINS)


def lowest_layers(
    counts: Float,
    sigma: float,
    threshold: float,
    tolerance: float = BIN_M / 2,
    least_below: float = MIN_BELOW_SHARE,
) -> Layers:
    """The ground in windows of which the returns by height are known.

    Args:
        counts: (..., BINS) see ``histograms``.
        sigma: standard deviation (m) of returns from bare ground about its surface.
        threshold: largest distance (m) from the ground of what may be taken.
        tolerance: height (m) over the ground that the mean of what is taken may have.
        least_below: share of the returns that must lie below the ground.
    """
    # farther below lie single returns (multipath), which would make a layer seem deep
    few = max(round(MAX_BELOW_SIGMAS * sigma / BIN_M), 1)
    rows = np.ascontiguousarray(counts, dtype=np.float64).reshape(-1, BINS)
    return Layers(*layer_rows(rows, sigma, few, threshold, tolerance, least_below).reshape(5, *counts.shape[:-1]))


def separate_layers(counts: Float, ground: Float) -> tuple[Bool, Float, Float]:
    """Windows whose lowest layer ends in a gap, as rough bare ground below plants does; its middle and scatter.

    The density of returns must fall to VALLEY of its peak within VALLEY_WITHIN_M above it; the peak is near the ground.

    Args:
        counts: (..., BINS) see ``histograms``.
        ground: (...) height of the ground as ``lowest_layers`` gave it, m.

    Returns:
        (...) bool, and heights in metres.
    """
    smooth = ndimage.gaussian_filter1d(counts, SMOOTHING_M / BIN_M, axis=-1, mode="constant")
    middles = np.broadcast_to(_MIDDLES, smooth.shape)
    reach = (middles >= ground[..., None] - PEAK_WITHIN_M) & (middles <= ground[..., None] + PEAK_WITHIN_M)
    at = np.argmax(np.where(reach, smooth, -1.0), axis=-1)
    peak = np.take_along_axis(smooth, at[..., None], axis=-1)
    above = (middles > _MIDDLES[at][..., None]) & (middles <= _MIDDLES[at][..., None] + VALLEY_WITHIN_M)
    low = above & (smooth <= VALLEY * peak)
    ends = low.any(axis=-1) & (peak[..., 0] > 0)
    end = _MIDDLES[np.argmax(low, axis=-1)]
    layer = (middles <= end[..., None]) & (middles >= 2.0 * _MIDDLES[at][..., None] - end[..., None])
    weight = np.where(layer, counts, 0.0)
    number = weight.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = (weight * _MIDDLES).sum(axis=-1) / number
        scatter = np.sqrt((weight * _MIDDLES**2).sum(axis=-1) / number - middle**2)
    return ends & (number >= MIN_LAYER_POINTS), middle, scatter


def _at(cumulated: Float, height: Float) -> Float:
    """Cumulated counts (..., BINS) up to a height (...)."""
    index = np.floor((height - LOWEST_M) / BIN_M + 1e-6).astype(np.int64) - 1
    found = np.take_along_axis(cumulated, np.clip(index, 0, BINS - 1)[..., None], axis=-1)[..., 0]
    return np.where(index < 0, 0.0, found)


def _layer_rows_by_numpy(
    counts: Float, sigma: float, few: int, threshold: float, tolerance: float, least_below: float
) -> Float:
    returns = counts.sum(axis=-1)
    number, moment = np.cumsum(counts, axis=-1), np.cumsum(counts * _MIDDLES, axis=-1)
    number_below, moment_below = number.copy(), moment.copy()
    number_below[..., few:] -= number[..., :-few]
    moment_below[..., few:] -= moment[..., :-few]
    with np.errstate(invalid="ignore", divide="ignore"):
        depth = EDGES[1:] - moment_below / number_below
    least = np.maximum(MIN_BELOW_POINTS, least_below * returns)[..., None]
    reached = (depth >= HALF_NORMAL_MEAN * sigma) & (number_below >= least)
    unknown = ~reached.any(axis=-1)
    ground = EDGES[1:][np.argmax(reached, axis=-1)]
    for _ in range(2):
        # bare ground that scatters less than sigma: the middle of what lies around
        low, high = _at(number, ground - 3.0 * sigma), _at(number, ground + 3.0 * sigma)
        middle = EDGES[1:][np.argmax(number >= ((low + high) / 2)[..., None], axis=-1)] - BIN_M / 2
        ground = np.minimum(ground, middle)
    lowest = ground - threshold
    number_from = number - _at(number, lowest)[..., None]
    moment_from = moment - _at(moment, lowest)[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = moment_from / number_from
    upper = EDGES[1:]
    within = (upper >= ground[..., None]) & (upper <= (ground + threshold)[..., None] + 1e-9)
    fits = within & (mean <= (ground + tolerance)[..., None])
    top = np.where(fits.any(axis=-1), upper[BINS - 1 - np.argmax(fits[..., ::-1], axis=-1)], ground)
    median = EDGES[1:][np.argmax(number >= returns[..., None] / 2, axis=-1)] - ground
    taken = _at(number, top) - _at(number, lowest)
    ground = np.where(unknown, np.nan, ground)
    return np.stack([ground, top, taken, returns, median])


@compiled(_layer_rows_by_numpy)
def layer_rows(counts: Float, sigma: float, few: int, threshold: float, tolerance: float, least_below: float) -> Float:
    """(5, m) the fields of ``Layers`` of windows with ``counts`` (m, BINS), see ``lowest_layers``.

    Returns more than ``few`` bins below a height are no evidence for the ground there.
    """
    windows, bins = counts.shape
    found = np.empty((5, windows))
    number, moment = np.empty(bins), np.empty(bins)
    for row in range(windows):
        returns = 0.0
        weighted = 0.0
        for b in range(bins):
            returns += counts[row, b]
            weighted += counts[row, b] * _MIDDLES[b]
            number[b], moment[b] = returns, weighted
        least = max(MIN_BELOW_POINTS, least_below * returns)
        ground = np.nan
        for b in range(bins):
            below = number[b] - (number[b - few] if b >= few else 0.0)
            if below >= least:
                lower = moment[b] - (moment[b - few] if b >= few else 0.0)
                if EDGES[b + 1] - lower / below >= HALF_NORMAL_MEAN * sigma:
                    ground = EDGES[b + 1]
                    break
        unknown = np.isnan(ground)
        if unknown:
            ground = EDGES[1]
        for _ in range(2):
            half = 0.0
            for side in (-3.0, 3.0):
                place = int(np.floor((ground + side * sigma - LOWEST_M) / BIN_M + 1e-6)) - 1
                if place >= 0:
                    half += number[min(place, bins - 1)]
            half /= 2
            b = 0
            while b < bins - 1 and number[b] < half:
                b += 1
            ground = min(ground, EDGES[b + 1] - BIN_M / 2)
        place = min(int(np.floor((ground - threshold - LOWEST_M) / BIN_M + 1e-6)) - 1, bins - 1)
        fewer, lighter = (number[place], moment[place]) if place >= 0 else (0.0, 0.0)
        top = ground
        for b in range(bins - 1, -1, -1):
            upper = EDGES[b + 1]
            if upper < ground:
                break
            taken = number[b] - fewer
            if upper <= ground + threshold + 1e-9 and (moment[b] - lighter) / taken <= ground + tolerance:
                top = upper
                break
        place = min(int(np.floor((top - LOWEST_M) / BIN_M + 1e-6)) - 1, bins - 1)
        b = 0
        while b < bins - 1 and number[b] < returns / 2:
            b += 1
        found[0, row] = np.nan if unknown else ground
        found[1, row] = top
        found[2, row] = (number[place] if place >= 0 else 0.0) - fewer
        found[3, row] = returns
        found[4, row] = EDGES[b + 1] - ground
    return found


def _counts_around_by_numpy(counts: Float, row: Index, column: Index, reach: int) -> Float:
    padded = np.pad(counts, ((reach, reach), (reach, reach), (0, 0)))
    total = np.zeros((len(row), counts.shape[2]))
    for i in range(2 * reach + 1):
        for j in range(2 * reach + 1):
            total += padded[row + i, column + j]
    return total


@compiled(_counts_around_by_numpy)
def counts_around(counts: Float, row: Index, column: Index, reach: int) -> Float:
    """(m, BINS) sums of ``counts`` (rows, columns, BINS) over squares of 2 ``reach`` + 1 windows a side around some.

    ``row`` and ``column`` (m,) are those in the middle.
    """
    rows, columns, bins = counts.shape
    total = np.zeros((len(row), bins))
    for k in range(len(row)):
        for i in range(max(row[k] - reach, 0), min(row[k] + reach + 1, rows)):
            for j in range(max(column[k] - reach, 0), min(column[k] + reach + 1, columns)):
                for b in range(bins):
                    total[k, b] += counts[i, j, b]
    return total
