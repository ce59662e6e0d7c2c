"""A power law through what was measured at several sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEAST_SIZES = 3


@dataclass(frozen=True)
class Law:
    """``value = factor * size ** exponent``; ``error`` is the standard error of the exponent."""

    exponent: float
    error: float
    factor: float

    def __call__(self, size: float) -> float:
        return self.factor * size**self.exponent


def fitted(sizes: Sequence[float], values: Sequence[float]) -> Law:
    """Least squares on the logarithms, which weigh each size alike.

    Args:
        sizes: positive, LEAST_SIZES of them at least.
        values: positive, as many.

    Raises:
        ValueError: they are too few, or one is not positive.
    """
    if len(sizes) < LEAST_SIZES or len(sizes) != len(values):
        raise ValueError(f"a power law needs {LEAST_SIZES} sizes, each with its value")
    if min(*sizes, *values) <= 0:
        raise ValueError("a power law goes through positive sizes and values only")
    x, y = np.log(sizes), np.log(values)
    spread = x - x.mean()
    exponent = float(spread @ y / (spread @ spread))
    constant = float(y.mean() - exponent * x.mean())
    rest = y - constant - exponent * x
    error = math.sqrt(float(rest @ rest) / (len(x) - 2) / float(spread @ spread))
    return Law(exponent, error, math.exp(constant))
