"""How many single vectors chance makes on still ground, where windows overlap and so err alike."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from scipy.special import chndtr, pdtr, pdtrik

from ..core.arrays import Bool
from .displacement import Displacement
from .scan import common_share
from .vectors import threshold

_SURE = 0.95
"""That chance stays below the largest count that is called one of chance."""
_STEPS = 400  # of the numerical integral


def chance_vectors(found: Displacement) -> tuple[float, int]:
    """Significant vectors that still ground shows: the number expected, and that which 95 % of such maps stay within.

    Both hold where errors are as stated. The confidence is that of all widths of windows together, and the narrower
    ones count only where the wider ones agree: no more than 1 - confidence of the windows exceed it.
    """
    measured = int(np.count_nonzero(found.vectors.measured))
    width = max((float(vectors.width.max()) for vectors in found.by_width if len(vectors.width)), default=0.0)
    return counts_by_chance(measured, found.grid.cell, width, found.confidence)


def beyond_chance(found: Displacement) -> Bool:
    """(n,) the significant vectors that are shown: those of zones, the others if there are more than chance makes."""
    inside = np.zeros(len(found.significant), dtype=bool)
    for zone in found.zones:
        inside[zone.windows] = True
    single = found.significant & ~inside
    more = np.count_nonzero(single) > chance_vectors(found)[1]
    return found.significant & (inside | more)


def counts_by_chance(measured: int, spacing: float, width: float, confidence: float) -> tuple[float, int]:
    """Expected number and 95 % limit of significant windows among ``measured`` ones on still ground.

    Windows are discs of ``width`` (m), ``spacing`` (m) apart. Discs that overlap share points, so that what exceeds
    its level comes in clumps; the limit is that of a Poisson distribution of clumps with the variance of the count.
    """
    if not measured:
        return 0.0, 0
    expected = measured * (1.0 - confidence)
    clump = variance_factor(width / spacing, confidence)
    return expected, math.floor(clump * _most_by_chance(expected / clump))


def _most_by_chance(expected: float) -> int:
    """The smallest number that a Poisson distribution does not exceed with the probability ``_SURE``."""
    most = max(math.ceil(pdtrik(_SURE, expected)), 0)
    return most - 1 if most and pdtr(most - 1, expected) >= _SURE else most


def variance_factor(width: float, confidence: float) -> float:
    """Variance of the number of exceeding windows on a large map over that of independent ones.

    Args:
        width: of a window in units of the windows' distance.
    """
    share, reach = 1.0 - confidence, math.ceil(width)
    total = 1.0
    for column, row in product(range(-reach, reach + 1), repeat=2):
        common = common_share(math.hypot(column, row) / width) if (column, row) != (0, 0) else 0.0
        if common > 0:
            total += (_both_exceed(common, confidence) - share**2) / (share * (1.0 - share))
    return total


def _both_exceed(correlation: float, confidence: float) -> float:
    """Probability that the squared lengths of two plane vectors with normal, correlated errors exceed their level."""
    level = threshold(confidence)
    # the squared length of the first beyond its level is exponential with a mean of 2
    steps = (np.arange(_STEPS) + 0.5) / _STEPS
    first = level - 2.0 * np.log1p(-steps)
    rest = 1.0 - correlation**2
    second = 1.0 - chndtr(level / rest, 2, correlation**2 * first / rest)
    return (1.0 - confidence) * float(second.mean())
