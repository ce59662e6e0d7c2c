"""Groups of neighbouring cells of significant change of one sign, of which zones are made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import log_ndtr

from ...interface.parameters import ZoneParameters
from ..core.arrays import Float
from ..grid.partition import Partition
from ..grid.plant_cells import clear_of_plants

_EIGHT_NEIGHBOURS = np.ones((3, 3), dtype=np.int8)
_MEAN_BY_CHANCE = 1.0 - float(np.log(0.05))
"""Mean of -ln p over the cells that chance alone brings beyond their level of 95 %."""


def label_groups(
    dz: NDArray[np.floating],
    significant: NDArray[np.bool_],
    parameters: ZoneParameters,
    partition: Partition,
    *,
    plants: Float | None = None,
    sigma: NDArray[np.floating] | None = None,
) -> NDArray[np.int32]:
    """Labels 1..n of the groups that are large enough, in the layout of ``partition``; 0 outside of them.

    The least area is asked of a group with the gaps without data that it encloses: where every second cell was
    measured, change over 1 m² shows in half as many cells.

    Args:
        partition: which cells are one. Towards the least number of cells a grown cell counts with the part of its
            square that the group holds: the rest of a square holds less evidence than all of it, and where finer cells
            lent it their points nothing new.
        plants: error of each cell's change by plants, metres: groups whose mean change is not beyond it
            (``plant_cells.clear_of_plants``) are left out.
        sigma: standard error of each cell's change, metres: a grown cell far beyond it counts for more than one
            (``cells_worth``).
    """
    cell, layout = partition.cell, partition.layout
    labels = np.zeros(dz.shape, dtype=np.int32)
    found = 0
    gaps = np.zeros(1, dtype=np.int64)
    unknown = layout.on_grid(np.isnan(dz), True)
    reach = int(parameters.bridged_gap / (2.0 * cell) + 1e-6)  # cells from either side of a gap
    for sign in (-1.0, 1.0):
        with np.errstate(invalid="ignore"):
            own = significant & (dz * sign > 0)
        cells = layout.on_grid(own)
        joined = between = cells
        if reach and cells.any():
            square = np.ones((2 * reach + 1,) * 2, dtype=bool)
            joined = cells | (ndimage.maximum_filter(cells, size=2 * reach + 1) & unknown)
            between = ndimage.binary_closing(cells, square) & unknown
        part, number = ndimage.label(joined, structure=_EIGHT_NEIGHBOURS)
        labels[own] = layout.of(part)[own] + found
        gaps = np.concatenate([gaps, np.bincount(part[between & ~cells], minlength=number + 1)[1:]])
        found += number
    sizes = np.bincount(labels.ravel(), minlength=found + 1)
    # a group of exactly the least area must not fail by rounding
    part_of_one = None
    if partition.grown:
        part_of_one = np.nan_to_num((cell / partition.sizes.ravel()) ** 2, nan=1.0)
        if sigma is not None:
            part_of_one *= cells_worth(dz, sigma, parameters.minimum_cells).ravel()
    number_of = np.bincount(labels.ravel(), part_of_one, minlength=found + 1)
    extent = (sizes + gaps) * cell**2
    enough = (number_of >= parameters.minimum_cells - 1e-6) & (extent >= parameters.minimum_area * (1 - 1e-9))
    if plants is not None:
        enough &= clear_of_plants(labels, found, np.asarray(dz, dtype=np.float64), plants)
    return without(labels, enough[1:])


def first_of_each(labels: NDArray[np.int32]) -> NDArray[np.int64]:
    """Index of the first cell of each group 1 to n of ``labels`` (of any shape), flattened, (n,)."""
    inside = np.flatnonzero(labels)
    return inside[np.unique(labels.ravel()[inside], return_index=True)[1]]


def without(labels: NDArray[np.int32], kept: NDArray[np.bool_]) -> NDArray[np.int32]:
    """The groups 1 to n of ``labels`` (of any shape) that are ``kept`` (n,), numbered anew in their order."""
    renumber = np.zeros(len(kept) + 1, dtype=np.int32)
    renumber[1:][kept] = np.arange(1, int(kept.sum()) + 1)
    return renumber[labels]


def cells_worth(dz: NDArray[np.floating], sigma: NDArray[np.floating], least: float) -> Float:
    """For how many cells each one counts towards the ``least`` number of a zone; arrays of one shape.

    That number guards against cells that lie beyond their level by chance. A small change under plants may show in two
    grown cells only, far beyond their level, which is no chance either. Improbabilities of independent cells add as
    -ln p (Fisher's method), and what chance brings beyond its level has ln 20 + 1 of it on average: a cell counts for
    as many of these as it holds, 1 at least. Errors of ground under plants may have heavier tails than a normal
    distribution, so no cell counts for more than half of the ``least`` number: two are always needed.

    Args:
        dz, sigma: change and its standard error, metres; a cell without either counts for 1.
    """
    most = max(least / 2.0, 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        improbable = -float(np.log(2.0)) - log_ndtr(-np.abs(np.asarray(dz, dtype=np.float64)) / sigma)
    worth = np.nan_to_num(improbable / _MEAN_BY_CHANCE, nan=1.0, posinf=most)
    return np.asarray(np.clip(worth, 1.0, most), dtype=np.float64)
