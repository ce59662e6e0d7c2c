"""How many single vectors chance makes on still ground, where windows overlap and so err alike."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from scipy.special import chdtri, chndtr, pdtr, pdtrik

from ..core.arrays import Bool
from .displacement import Displacement
from .scan import common_share

_SURE = 0.95
"""That chance stays below the largest count that is called one of chance."""
_STEPS = 400  # of the numerical integral


def chance_vectors(found: Displacement) -> tuple[float, int]:
    """Significant vectors that still ground shows: the number expected, and that which 95 % of such maps stay within.

    Both hold if errors are as stated. Neighbours that count make errors alike farther than a window is wide, but bring
    fewer windows beyond their level than the confidence allows: 5 of 3,809 on 32 still maps, where 38 are expected.
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


def components_beyond_chance(found: Displacement) -> Bool:
    """(k,) the significant components that are shown: all of them if they are more than chance makes, else none.

    Components of windows that overlap are taken as equal in direction, which makes the limit larger.
    """
    parts, use = found.components, found.significant_components
    width = float(parts.width.max()) if len(parts.width) else 0.0
    most = counts_by_chance(len(use), found.grid.cell, width, found.confidence, 1)[1]
    return use & (np.count_nonzero(use) > most)


def counts_by_chance(
    measured: int, spacing: float, width: float, confidence: float, dimensions: int = 2
) -> tuple[float, int]:
    """Expected number and 95 % limit of significant windows among ``measured`` ones on still ground.

    Windows are discs of ``width`` (m), ``spacing`` (m) apart. Discs that overlap share points, so that what exceeds
    its level comes in clumps; the limit is that of a Poisson distribution of clumps with the variance of the count.
    """
    if not measured:
        return 0.0, 0
    expected = measured * (1.0 - confidence)
    clump = variance_factor(width / spacing, confidence, dimensions)
    return expected, math.ceil(clump * _most_by_chance(expected / clump))


def _most_by_chance(expected: float) -> int:
    """The smallest number that a Poisson distribution does not exceed with the probability ``_SURE``."""
    most = max(math.ceil(pdtrik(_SURE, expected)), 0)
    return most - 1 if most and pdtr(most - 1, expected) >= _SURE else most


def variance_factor(width: float, confidence: float, dimensions: int = 2) -> float:
    """Variance of the number of exceeding windows on a large map over that of independent ones.

    Args:
        width: of a window in units of the windows' distance.
        dimensions: 2 for vectors along the surface, 1 for components.
    """
    share, reach = 1.0 - confidence, math.ceil(width)
    total = 1.0
    for column, row in product(range(-reach, reach + 1), repeat=2):
        common = float(common_share(math.hypot(column, row) / width)) if (column, row) != (0, 0) else 0.0
        if common > 0:
            total += (_both_exceed(common, confidence, dimensions) - share**2) / (share * (1.0 - share))
    return total


def _both_exceed(correlation: float, confidence: float, dimensions: int) -> float:
    """Probability that the squared lengths of two vectors with normal, correlated errors exceed their level."""
    steps = (np.arange(_STEPS) + 0.5) / _STEPS
    level, first = (chdtri(dimensions, (1.0 - confidence) * share) for share in (1.0, steps))
    rest = 1.0 - correlation**2
    second = 1.0 - chndtr(level / rest, dimensions, correlation**2 * first / rest)
    return (1.0 - confidence) * float(second.mean())
