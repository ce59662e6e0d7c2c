"""Ground that did not change, found in a difference of elevation models whose errors are alike over many cells."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ..change.stable_ground import with_other_slopes
from ..core.arrays import Bool, Float
from ..statistics.robust import nmad

_WINDOW_CELLS = 5  # along the side of the square over which a change is looked for as a whole
_MAX_CELL_DEVIATIONS = 20.0  # one cell that is no surface makes no changed place
_CORE_DEVIATIONS, _EDGE_DEVIATIONS = 4.0, 2.0  # of the means: where a change is, and how far it reaches from there
_MAX_ROUNDS = 20
_MIN_CELLS = 100


def stable_cells(dz: Float, error: Float) -> Bool:
    """Cells that are no part of a change, (rows, columns).

    The mean of dz / error in squares of five cells is compared with its own robust scatter, which holds what a campaign
    has in common over many cells. Where it is four times as large, and around there as far as it is twice as large on
    the same side, the ground has changed; the scatter is taken again without that until nothing changes. Change of a
    third of the ground is found, as the scatter is a median.

    Args:
        dz: change with its bias taken off, metres, NaN where unknown.
        error: standard error by the terrain, metres.
    """
    known = np.isfinite(dz) & np.isfinite(error) & (error > 0)
    if int(known.sum()) < _MIN_CELLS:
        return known
    z = np.where(known, np.clip(dz / np.where(known, error, 1.0), -_MAX_CELL_DEVIATIONS, _MAX_CELL_DEVIATIONS), 0.0)
    total = ndimage.uniform_filter(z, _WINDOW_CELLS, mode="constant")
    share = ndimage.uniform_filter(known.astype(np.float64), _WINDOW_CELLS, mode="constant")
    mean = np.where(known, total / np.maximum(share, 1e-12), 0.0)
    stable = known
    for _ in range(_MAX_ROUNDS):
        about = float(np.median(mean[stable]))
        scatter = max(nmad(mean[stable], about), 1.0 / _WINDOW_CELLS)
        left = known & ~_changed((mean - about) / scatter)
        if int(left.sum()) < _MIN_CELLS or np.array_equal(left, stable):
            break
        stable = left
    return stable


def _changed(mean: Float) -> Bool:
    found = np.zeros(mean.shape, dtype=bool)
    for side in (mean, -mean):
        core, edge = side > _CORE_DEVIATIONS, side > _EDGE_DEVIATIONS
        found |= ndimage.binary_propagation(core, mask=edge, structure=np.ones((3, 3)))
    # the squares around the cells beside a change hold some of it
    return np.asarray(ndimage.binary_dilation(found, np.ones((3, 3)), iterations=_WINDOW_CELLS // 2))


def stable_ground_of(dz: Float, error: Float, slope: Float, given: Bool | None) -> Bool:
    """The cells ``given`` as stable, and of slopes (degrees) beyond theirs those found; all that are found without."""
    found = stable_cells(dz, error)
    return found if given is None else with_other_slopes(given & np.isfinite(dz), found, slope)
