"""Scatter that outliers do not affect."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NORMALISED = 1.4826
"""Standard deviation of a normal distribution in units of its median absolute deviation."""
# the 30 % quantile of |r| is 0.385 standard deviations: it stands 60 % of change
_CORE_QUANTILE, _NORMAL_CORE_QUANTILE = 0.3, 0.38532


def nmad(values: NDArray[np.floating], middle: float | None = None) -> float:
    """Normalised median absolute deviation of ``values`` (n,), in their unit, about their median or ``middle``.

    Of normal values it is their standard deviation (Höhle and Höhle 2009, doi:10.1016/j.isprsjprs.2009.02.003).
    """
    about = np.median(values) if middle is None else middle
    return NORMALISED * float(np.median(np.abs(values - about)))


def robust_scale(residual: NDArray[np.float64]) -> float:
    """Standard deviation of the core of residuals (n,), in their unit, whatever the other 60 % are; 0 for none.

    A quantile near zero belongs to the unchanged ground as long as that is the largest part near zero; what lies
    outside three of it is then left out and the quantile taken again.
    """
    size = np.sort(np.abs(residual))
    scale = np.inf
    for _ in range(5):
        size = size[: np.searchsorted(size, 3 * scale, side="right")]
        if not len(size):
            return 0.0
        scale = float(size[int(_CORE_QUANTILE * (len(size) - 1))]) / _NORMAL_CORE_QUANTILE
    return scale
