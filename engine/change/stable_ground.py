"""Which ground of a difference is taken as stable, and whether the difference itself shows enough of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from .measured import Measured
from .plant_calibration import plants_factor, squares_of
from .stable_cells import changed_cells, find_stable

MAX_CHANGED_SHARE = 0.3
"""Share of the compared ground that may have changed as a whole for the rest to be known as stable. Edges of what
changed do not count as changed as a whole, so this is a third of the ground and more."""
MIN_STABLE_SHARE = 0.5
"""... and the share that must be found stable, because it is judged by what most of the ground does."""
# degrees beyond the slopes of known stable ground, from which that is no evidence for a cell
_MAX_SLOPE_EXTRAPOLATION_DEG = 5.0


@dataclass(frozen=True)
class StableGround:
    """The cells taken as ``stable``, an array as in ``Measured``, and the notes on the rest.

    ``changed_share`` of the compared cells have changed as a whole (0 where stable ground is given), ``looks_stable``
    is the share found stable. Not ``settled``: too much has changed for the rest to be known as stable.
    """

    stable: NDArray[np.bool_]
    changed_share: float
    looks_stable: float
    settled: bool


def stable_ground(
    measured: Measured,
    *,
    registration_error: float,
    uniform: bool = False,
    given: NDArray[np.bool_] | None = None,
) -> StableGround:
    """Stable cells of a difference.

    Args:
        registration_error: metres.
        uniform: the whole overlap has moved alike, so that there is no stable ground in it.
        given: cells known to be stable; of slopes beyond theirs, stable cells found count, too.
    """
    dz, sampling, slope, plants = measured.dz, measured.sampling, measured.slope, measured.by_plants
    partition = measured.partition
    valid = np.isfinite(dz)
    number = max(int(valid.sum()), 1)
    found = np.zeros(dz.shape, dtype=bool)
    if not uniform:
        found = find_stable(dz, sampling, slope, partition, _usual_error(measured))
    looks_stable = float(found.sum()) / number
    if given is not None:
        return StableGround(with_other_slopes(given & valid, found, slope), 0.0, looks_stable, settled=True)
    if uniform:
        return StableGround(found, 0.0, looks_stable, settled=True)
    stated = np.hypot(sampling, registration_error)
    whole = stated if plants is None else np.hypot(stated, plants)
    changed = changed_cells(dz, whole, partition.cell, partition.layout)
    share = float(changed.sum()) / number
    if share > MAX_CHANGED_SHARE or looks_stable < MIN_STABLE_SHARE:
        return StableGround(found & ~changed, share, looks_stable, settled=False)
    return StableGround(found, share, looks_stable, settled=True)


def _usual_error(measured: Measured) -> Float | None:
    """Error by plants that half of all compared cells show, at most the stated one: it is no measure of a change.

    In surveys of one season a small part of the stated error is left. A change within five times the stated error would
    pass for stable ground.
    """
    plants, partition = measured.by_plants, measured.partition
    if plants is None:
        return None
    compared = partition.one_each(np.isfinite(measured.dz))
    squares = squares_of(partition.layout, partition.cell)
    median = {"registration_error": 0.0, "confidence": 0.5}
    return plants * plants_factor(measured.dz, measured.sampling, plants, compared, squares, **median)


def with_other_slopes(given: NDArray[np.bool_], found: NDArray[np.bool_], slope: Float) -> NDArray[np.bool_]:
    """The given cells, and found ones much flatter or steeper than those: a road is no evidence for a rock face."""
    inside = slope[given & np.isfinite(slope)]
    if not inside.size:
        return given
    low, high = np.quantile(inside, [0.02, 0.98]) + np.array(
        [-_MAX_SLOPE_EXTRAPOLATION_DEG, _MAX_SLOPE_EXTRAPOLATION_DEG]
    )
    with np.errstate(invalid="ignore"):
        return given | (found & ((slope < low) | (slope > high)))
