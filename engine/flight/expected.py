"""What two such surveys would show of each place: level of detection and smallest motion along the surface."""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from ..core.arrays import Float
from ..grid.chosen_cell import CELL_SIDES_M, MAX_GROWN_SIDE_M, MIN_POINTS
from ..statistics.normal import quantile
from .last_survey import Scatter

TARGET_LEVEL_M = 0.05
"""Level at which a cell of the change stops growing, as the change's own default."""
MOTION_ERROR_M, MOTION_DENSITY, MOTION_WINDOW_M, MOTION_EXPONENT = 0.028, 70.0, 5.0, 0.67
"""Standard error along the dip of a window of 5 m at 70 ground returns a m² of map, and how it falls with density."""
_STANDARD_ERRORS = 3.0  # of the smallest motion
_MORE_DOUBLINGS = 4  # of cells that have too few points at ``MAX_GROWN_SIDE_M``
_DRAWS = 64


def first_cell(density: Float) -> float:
    """The cell that the change begins with: the listed one next to the distance of the returns at the median return.

    Args:
        density: (n,) ground returns a m² of map, of places of one size.
    """
    known = np.sort(density[density > 0])
    if not known.size:
        return CELL_SIDES_M[-1]
    sums = np.cumsum(known)
    middle = known[min(int(np.searchsorted(sums, sums[-1] / 2)), known.size - 1)]
    return min(CELL_SIDES_M, key=lambda side: abs(math.log(side * math.sqrt(middle))))


def expected_level(density: Float, scatter: Scatter, registration_error: float, confidence: float) -> Float:
    """Level of detection (n,) of two surveys with ``density`` (n,) ground returns a m² of map each, metres.

    Cells grow as those of the change do (``grid.grown_cells``): from ``first_cell`` on they double until both surveys
    have ``MIN_POINTS`` returns in them and q sqrt(s^2 (1/n1 + 1/n2) + r^2) is at most ``TARGET_LEVEL_M``, or the
    registration's error r is the larger part; from ``MAX_GROWN_SIDE_M`` on the number alone counts. q is the normal
    quantile of the confidence, s the scatter about a plane in a square of that side. How many returns a cell gets is
    drawn from Poisson's distribution, evenly over its quantiles; the level is the median over the draws.
    NaN where no cell would have enough.
    """
    cell = first_cell(density)
    steps = math.ceil(math.log2(MAX_GROWN_SIDE_M / cell) - 1e-9) if cell < MAX_GROWN_SIDE_M else 0
    q = quantile(confidence)
    even = (np.arange(_DRAWS) + 0.5) / _DRAWS
    # two sequences of quantiles that do not go together
    pairs = np.column_stack([even, even[(np.arange(_DRAWS) * 25) % _DRAWS]])
    level = np.full((len(density), _DRAWS), np.nan)
    for step in range(steps + _MORE_DOUBLINGS + 1):
        side = cell * 2**step
        mean = (density * side**2)[:, None]
        counts = [stats.poisson.ppf(pairs[:, k], mean) for k in (0, 1)]
        with np.errstate(divide="ignore"):
            sampling = scatter.at(side) * np.sqrt(1.0 / counts[0] + 1.0 / counts[1])
        found = q * np.hypot(sampling, registration_error)
        enough = np.minimum(*counts) >= MIN_POINTS
        if step < steps:
            enough &= (found <= TARGET_LEVEL_M) | (sampling <= registration_error)
        level = np.where(np.isnan(level) & enough, found, level)
    result = np.full(len(density), np.nan)
    served = np.isfinite(level).mean(axis=1) >= 0.5
    result[served] = np.nanmedian(level[served], axis=1)
    return result


def smallest_motion(density: Float, window: float) -> Float:
    """Smallest motion along the surface (n,) that a window of ``window`` m would show, metres; NaN without returns.

    Three standard errors along the dip: 0.028 m (70 / density)^0.67 (5 m / window), as measured with the displacement
    of simulated slopes of natural roughness at 30, 70 and 200 ground returns a m² (docs/flight.md). The registration's
    error along the surface is not in it, and smooth ground, such as concrete, shows none of it.
    """
    with np.errstate(divide="ignore"):
        error = MOTION_ERROR_M * (MOTION_DENSITY / density) ** MOTION_EXPONENT * (MOTION_WINDOW_M / window)
    return np.where(density > 0, _STANDARD_ERRORS * error, np.nan)
