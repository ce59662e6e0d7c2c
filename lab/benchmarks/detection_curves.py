"""Curves of the detection benchmark: recall and false zones with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import binomtest, chi2

from ...engine.core.arrays import Float
from .detection_results import Detected, PairResult


@dataclass(frozen=True)
class Recall:
    """A class of changes: their median size, how many of them were found, and the exact binomial interval (Clopper
    and Pearson 1934, doi:10.1093/biomet/26.4.404) of the share that is.
    """

    size: float
    found: int
    count: int
    low: float
    high: float

    @property
    def share(self) -> float:
        return self.found / self.count


def recall(pairs: Sequence[PairResult], size: Callable[[Detected], float], edges: Sequence[float]) -> list[Recall]:
    """Recall by the classes of ``size`` between ``edges``, the lower one included; empty classes are left out.

    Changes of size 0 belong to no class: so have, over their level, those of which nothing was measured.
    """
    changes = [c for pair in pairs for c in pair.changes]
    curve = []
    for low, high in pairwise(edges):
        own = [c for c in changes if low <= size(c) < high and size(c) > 0]
        if own:
            found = sum(c.found for c in own)
            interval = binomtest(found, len(own)).proportion_ci(0.95, method="exact")
            middle = float(np.median([size(c) for c in own]))
            curve.append(Recall(middle, found, len(own), interval.low, interval.high))
    return curve


@dataclass(frozen=True)
class FalseAlarms:
    """False zones a slope whose change is ``ratio`` times their level or more, with the exact Poisson interval (Garwood
    1936, doi:10.1093/biomet/28.3-4.437); arrays of one length.
    """

    ratio: Float
    a_slope: Float
    low: Float
    high: Float


def false_alarms(pairs: Sequence[PairResult], ratios: Sequence[float]) -> FalseAlarms:
    """On the pairs given, at each of ``ratios``."""
    own = np.array([zone.ratio for pair in pairs for zone in pair.false_zones])
    count = np.array([np.count_nonzero(own >= ratio) for ratio in ratios], dtype=np.float64)
    low = np.where(count > 0, chi2.ppf(0.025, 2 * np.maximum(count, 0.5)) / 2, 0.0)
    high = chi2.ppf(0.975, 2 * (count + 1)) / 2
    slopes = len(pairs)
    return FalseAlarms(np.asarray(ratios, dtype=np.float64), count / slopes, low / slopes, high / slopes)
