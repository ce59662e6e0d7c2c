"""Which cells have changed: the four thresholds of a difference of heights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from ...interface.parameters import GridChangeParameters
from ..core.arrays import Float
from ..grid.part_windows import sums_around
from ..grid.partition import Partition
from ..statistics.normal import quantile

_WINDOW_CELLS = 5  # cells along the side of the window of spatial coherence
# shares of the window that have changed alike from which coherence counts, and counts fully
_MIN_ALIKE_SHARE, _FULL_ALIKE_SHARE = 0.6, 1.0


@dataclass(frozen=True)
class Decision:
    """Level of detection (rows, columns; metres), which cells are beyond it, and how probably each has changed.

    ``probability`` is the posterior probability that the change is real, of ``coherent`` only; that one decides by the
    probability, and its ``level`` is what the cell alone would have to exceed.
    """

    level: Float
    significant: NDArray[np.bool_]
    probability: Float | None = None


def stated_error(parameters: GridChangeParameters) -> float | None:
    """Standard error (m) that a threshold states for every cell, so that it need not be estimated from the points; else
    None.

    The propagated errors of both surveys, or the one whose level is the constant level.
    """
    if parameters.threshold == "propagated":
        return math.hypot(parameters.error_from, parameters.error_to)
    if parameters.threshold == "constant":
        return parameters.constant_level / quantile(parameters.confidence)
    return None


def decide(dz: Float, error: Float, parameters: GridChangeParameters, partition: Partition) -> Decision:
    """Apply ``parameters.threshold`` to the change ``dz`` with standard error ``error`` (both metres, NaN: no data).

    - constant: one level for every cell, whatever its error.
    - propagated: quantile times the quadrature of the errors stated for both epochs (Brasington et al. 2003,
      doi:10.1016/S0169-555X(02)00320-3), for every cell alike.
    - probabilistic: |dz| / error beyond the quantile (Lane et al. 2003, doi:10.1002/esp.483).
    - coherent: posterior probability, from that of the cell alone and how many around it changed alike, beyond
      ``confidence`` (Wheaton et al. 2010, doi:10.1002/esp.1886).
    """

    def alike(level: float) -> Float:
        return np.where(np.isfinite(dz), level, np.nan)

    if parameters.threshold == "constant":
        return _beyond(dz, alike(parameters.constant_level))
    z = quantile(parameters.confidence)
    if parameters.threshold == "propagated":
        return _beyond(dz, alike(z * math.hypot(parameters.error_from, parameters.error_to)))
    level = z * error
    if parameters.threshold == "probabilistic":
        return _beyond(dz, level)
    posterior = coherent_probability(dz, error, partition)
    with np.errstate(invalid="ignore"):
        return Decision(level, posterior > parameters.confidence, posterior)


def _beyond(dz: Float, level: Float) -> Decision:
    with np.errstate(invalid="ignore"):
        return Decision(level, np.abs(dz) > level)


def coherent_probability(dz: Float, error: Float, partition: Partition) -> Float:
    """Posterior probability that a cell's change is real; NaN where ``dz`` is.

    Prior: two-sided probability of the cell alone, erf(|dz| / (error sqrt 2)). Likelihood: from the share of the
    measured cells in a window of 5 by 5 that changed with the cell's sign; 0 up to 60 %, 1 where all did, linear in
    between. Posterior by Bayes' theorem: p L / (p L + (1 - p) (1 - L)). Where cells grew, each part counts once, and
    the window is five of its own sides wide.
    """

    def number(cells: NDArray[np.bool_]) -> Float:
        return sums_around(partition, cells, _WINDOW_CELLS)

    known = np.isfinite(dz) & np.isfinite(error)
    with np.errstate(invalid="ignore", divide="ignore"):
        prior = erf(np.abs(dz) / (error * math.sqrt(2.0)))
        alike = np.where(dz < 0, number(known & (dz < 0)), number(known & (dz > 0))) / number(known)
        likelihood = np.clip((alike - _MIN_ALIKE_SHARE) / (_FULL_ALIKE_SHARE - _MIN_ALIKE_SHARE), 0.0, 1.0)
        joint = prior * likelihood
        posterior = joint / (joint + (1.0 - prior) * (1.0 - likelihood))
    # a prior of 1 with a likelihood of 0, or the reverse: what excludes the change counts
    return np.where(known, np.nan_to_num(posterior), np.nan)
