"""Gaps of a grid filled from what is known nearest to them."""

from __future__ import annotations

from scipy import ndimage

from ..core.arrays import Bool, Index


def nearest_known(known: Bool) -> tuple[Index, ...]:
    """Row and column, each (rows, columns), of the cell of ``known`` nearest to each cell, its own if it is one.

    ``values[nearest_known(known)]`` has no gaps. At least one cell must be known.
    """
    return tuple(ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True))
