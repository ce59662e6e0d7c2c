"""What two such surveys would show of each place: level of detection and smallest motion along the surface."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from ..core.arrays import Float
from ..grid.chosen_cell import CELL_SIDES_M, MAX_GROWN_SIDE_M, MIN_POINTS
from ..statistics.normal import quantile
from .last_survey import CLUMP_M, Scatter

TARGET_LEVEL_M = 0.05
"""Level at which a cell of the change stops growing, as the change's own default."""
MOTION_ERROR_M, MOTION_DENSITY, MOTION_WINDOW_M, MOTION_EXPONENT = 0.028, 70.0, 5.0, 0.67
"""Standard error along the dip of a window of 5 m at 70 ground returns a m² of map, and how it falls with density."""
_STANDARD_ERRORS = 3.0  # of the smallest motion
_MORE_DOUBLINGS = 3  # of cells that have too few points at ``MAX_GROWN_SIDE_M``
_FIELD = 128  # cells along the side of a field of random returns
_DENSITY_RATIO = 1.4  # of two densities for which cells are grown
_CLUMPINGS = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)


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


def expected_level(
    density: Float,
    clumping: Float,
    scatter: Scatter,
    registration_error: float,
    confidence: float,
    plant_error: Float | float = 0.0,
) -> Float:
    """Level of detection (n,) of two surveys with ``density`` (n,) ground returns a m² of map each, metres.

    Cells of random returns are grown as the change grows them (``grown_level``), for densities and clumpings between
    which the places' are interpolated. NaN where there are no returns or no cell would have enough.

    Args:
        clumping: (n,) or one: variance of the density within a place, in squares of its mean; 0: even.
        plant_error: (n,) or one: standard error of the change that plants make, which no cell averages out, metres.
    """
    result = np.full(len(density), np.nan)
    chosen = density > 0
    if not chosen.any():
        return result
    cell = first_cell(density)
    low, high = float(density[chosen].min()), float(density[chosen].max())
    count = 2 + math.ceil(math.log(high / low) / math.log(_DENSITY_RATIO))
    densities = np.geomspace(low, high * 1.0001, count)
    clumps = np.broadcast_to(clumping, density.shape)[chosen]
    # as few as the places need
    steps = _CLUMPINGS[: 1 + int(np.searchsorted(_CLUMPINGS, min(float(clumps.max()), _CLUMPINGS[-1])))]
    table = np.array(
        [[grown_level(d, c, scatter, cell, registration_error, confidence) for c in steps] for d in densities]
    )
    row = np.interp(np.log(density[chosen]), np.log(densities), np.arange(count))
    column = np.interp(clumps, steps, np.arange(len(steps)))
    found = ndimage.map_coordinates(table, [row, column], order=1, mode="nearest")
    plants = quantile(confidence) * np.broadcast_to(plant_error, density.shape)[chosen]
    result[chosen] = np.hypot(found, plants)
    return result


def grown_level(
    density: float, clumping: float, scatter: Scatter, cell: float, registration_error: float, confidence: float
) -> float:
    """Median level of detection over the cells of a field of random returns, metres; NaN where most have none.

    From ``cell`` on, squares double until both surveys have ``MIN_POINTS`` returns in them and q sqrt(s^2 (1/n1 + 1/n2)
    + r^2) is at most ``TARGET_LEVEL_M``, or the registration's error r is the larger part; from ``MAX_GROWN_SIDE_M`` on
    the number alone counts. What is taken leaves with its returns, and what is left of a square is less than a square
    (``grid.grown_cells``). q is the normal quantile of the confidence, s the scatter about a plane in a square of that
    side. Returns are Poisson's, of a density that varies over patches of 0.4 m by a gamma distribution.
    """
    rng = np.random.default_rng(1)
    mean = np.full((_FIELD, _FIELD), density * cell**2)
    if clumping > 0:
        patch = max(1, round(CLUMP_M / cell))
        many = math.ceil(_FIELD / patch)
        varied = rng.gamma(1.0 / clumping, clumping, (many, many))
        mean *= np.kron(varied, np.ones((patch, patch)))[:_FIELD, :_FIELD]
    left = [rng.poisson(mean).astype(float) for _ in range(2)]
    whole = list(left)
    steps = math.ceil(math.log2(MAX_GROWN_SIDE_M / cell) - 1e-9) if cell < MAX_GROWN_SIDE_M else 0
    q, level = quantile(confidence), np.full((_FIELD, _FIELD), np.nan)
    spare = level.copy()
    for step in range(min(steps + _MORE_DOUBLINGS, int(math.log2(_FIELD))) + 1):
        deviation, counted_alone = scatter.at(cell * 2**step), step >= steps
        for target, counts in ((level, left), (spare, whole)):
            with np.errstate(divide="ignore"):
                sampling = deviation * np.sqrt(1.0 / counts[0] + 1.0 / counts[1])
            found = q * np.hypot(sampling, registration_error)
            enough = np.minimum(*counts) >= MIN_POINTS
            enough &= counted_alone | (found <= TARGET_LEVEL_M) | (sampling <= registration_error)
            if target is level:
                for survey in left:
                    survey[enough] = 0.0
            spread = np.kron(np.where(enough, found, np.nan), np.ones((2**step, 2**step)))
            fill = np.isnan(target)
            target[fill] = spread[fill]
        left, whole = ([_merged(survey) for survey in surveys] for surveys in (left, whole))
        if left[0].shape == (0, 0):
            break
    served = np.where(np.isnan(level), spare, level)
    return float(np.nanmedian(served)) if np.isfinite(served).mean() >= 0.5 else math.nan


def _merged(counts: Float) -> Float:
    """Sums over squares of two by two."""
    rows, columns = counts.shape
    return np.asarray(counts.reshape(rows // 2, 2, columns // 2, 2).sum(axis=(1, 3))) if rows > 1 else np.empty((0, 0))


def smallest_motion(density: Float, window: float) -> Float:
    """Smallest motion along the surface (n,) that a window of ``window`` m would show, metres; NaN without returns.

    Three standard errors along the dip: 0.028 m (70 / density)^0.67 (5 m / window), as measured with the displacement
    of simulated slopes of natural roughness at 30, 70 and 200 ground returns a m² (docs/flight.md). The registration's
    error along the surface is not in it, and smooth ground, such as concrete, shows none of it.
    """
    with np.errstate(divide="ignore"):
        error = MOTION_ERROR_M * (MOTION_DENSITY / density) ** MOTION_EXPONENT * (MOTION_WINDOW_M / window)
    return np.where(density > 0, _STANDARD_ERRORS * error, np.nan)
