"""Scatter that outliers do not affect."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NORMALISED = 1.4826
"""Standard deviation of a normal distribution in units of its median absolute deviation."""


def nmad(values: NDArray[np.floating], middle: float | None = None) -> float:
    """Normalised median absolute deviation of ``values`` (n,), in their unit, about their median or ``middle``.

    Of normal values it is their standard deviation (Höhle and Höhle 2009, doi:10.1016/j.isprsjprs.2009.02.003).
    """
    about = np.median(values) if middle is None else middle
    return NORMALISED * float(np.median(np.abs(values - about)))
