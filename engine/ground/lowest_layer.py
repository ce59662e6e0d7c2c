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

from ..core.arrays import Bool, Float

BIN_M = 0.005
LOWEST_M, HIGHEST_M = -0.3, 0.7
BINS = round((HIGHEST_M - LOWEST_M) / BIN_M)
HALF_NORMAL_MEAN = 0.798
LEAST_BELOW, LEAST_BELOW_SHARE = 1.5, 0.004
"""Points that must lie below the ground for it to be believed: at least, and of all returns."""
SMOOTHING_M, PEAK_WITHIN_M, VALLEY_WITHIN_M, VALLEY = 0.02, 0.1, 0.15, 0.35
"""Of a separate lowest layer: smoothing of the density, distance of its peak from the ground, and where it must fall to
what share of it."""
FEWEST_IN_LAYER = 45.0
FARTHEST_BELOW = 4.0
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
    least_below: float = LEAST_BELOW_SHARE,
) -> Layers:
    """The ground in windows of which the returns by height are known.

    Args:
        counts: (..., BINS) see ``histograms``.
        sigma: standard deviation (m) of returns from bare ground about its surface.
        threshold: largest distance (m) from the ground of what may be taken.
        tolerance: height (m) over the ground that the mean of what is taken may have.
        least_below: share of the returns that must lie below the ground.
    """
    returns = counts.sum(axis=-1)
    number, moment = np.cumsum(counts, axis=-1), np.cumsum(counts * _MIDDLES, axis=-1)
    # farther below lie single returns (multipath), which would make a layer seem deep
    few = max(round(FARTHEST_BELOW * sigma / BIN_M), 1)
    number_below, moment_below = number.copy(), moment.copy()
    number_below[..., few:] -= number[..., :-few]
    moment_below[..., few:] -= moment[..., :-few]
    with np.errstate(invalid="ignore", divide="ignore"):
        depth = EDGES[1:] - moment_below / number_below
    least = np.maximum(LEAST_BELOW, least_below * returns)[..., None]
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
    return Layers(ground, top, taken, returns, median)


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
    return ends & (number >= FEWEST_IN_LAYER), middle, scatter


def _at(cumulated: Float, height: Float) -> Float:
    """Cumulated counts (..., BINS) up to a height (...)."""
    index = np.floor((height - LOWEST_M) / BIN_M + 1e-6).astype(np.int64) - 1
    found = np.take_along_axis(cumulated, np.clip(index, 0, BINS - 1)[..., None], axis=-1)[..., 0]
    return np.where(index < 0, 0.0, found)
