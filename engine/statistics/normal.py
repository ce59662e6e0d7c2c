"""Quantiles of the normal distribution."""

from __future__ import annotations

from statistics import NormalDist


def quantile(confidence: float) -> float:
    """Two-sided standard normal quantile: 1.96 for 0.95."""
    return NormalDist().inv_cdf((1 + confidence) / 2)


Z95 = 1.959963984540054
