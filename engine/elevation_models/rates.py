"""Rates of cells from elevation models of three or more dates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from ..core.arrays import Float

_DAYS_PER_YEAR = 365.25
_MIN_SHARE = 0.05  # of the mean variance, that a model has at least: none is free of errors
Indices = tuple[int, int]


@dataclass(frozen=True)
class Rates:
    """Rate of each cell and its standard error, (rows, columns), mm a year; NaN where a model has no height."""

    rate: Float
    error: Float


def model_variances(squares: Mapping[Indices, float], count: int) -> Float:
    """Variance of each of ``count`` models (count,), m², from those of their differences.

    Errors of two models are independent, so that the variance of a difference is the sum of theirs. With the changes
    against the first and in steps there are more differences than models; least squares without negative ones.

    Args:
        squares: variance of the difference of two models, m².
    """
    design = np.zeros((len(squares), count))
    for row, pair in zip(design, squares, strict=True):
        row[list(pair)] = 1.0
    values = np.array(list(squares.values()))
    found: Float = nnls(design, values)[0]
    return np.maximum(found, _MIN_SHARE * float(values.mean()))


def cell_rates(days: Sequence[int], change: Sequence[Float], errors: Mapping[Indices, Float]) -> Rates:
    """Weighted regression of the heights of each cell on time.

    The weights are the models' variances at the median cell. The error of a cell's rate follows from its own: each
    model's share of them is the same everywhere, their size is that of the cell.

    Args:
        days: of each model, since the first.
        change: (rows, columns) of each model from the second on against the first, metres.
        errors: standard error of the difference of two models (rows, columns), metres.
    """
    typical = {pair: float(np.nanmedian(values**2)) for pair, values in errors.items()}
    variance = model_variances(typical, len(days))
    at = np.asarray(days, dtype=np.float64) / _DAYS_PER_YEAR
    weight = 1.0 / variance
    about = at - np.average(at, weights=weight)
    factor = weight * about / np.sum(weight * about**2)
    rate = sum(f * values for f, values in zip(factor[1:].tolist(), change, strict=True))
    size = np.mean([values**2 / typical[pair] for pair, values in errors.items()], axis=0)
    error = np.sqrt(float(np.sum(factor**2 * variance)) * size)
    known = np.isfinite(rate) & np.isfinite(error)
    return Rates(*(np.where(known, 1000.0 * values, np.nan) for values in (rate, error)))
