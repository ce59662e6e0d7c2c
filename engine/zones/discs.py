"""Discs in and around a group of cells: over them a change shows whatever shape the cells beyond their level have."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..statistics.mask_sums import mask_sums

_STEP = math.sqrt(2.0)  # of radii


def best_discs(change: Float, error: Float, usable: NDArray[np.bool_], own: NDArray[np.bool_]) -> Iterator[Float]:
    """Of each radius the disc about a cell of ``own`` with the largest mean change over its error; 0 or 1 a cell.

    Cells of a disc count whatever their own change is, so that noise chooses no more than the disc's place and size.
    Radii double their area from one to the next, up to the half of the group's longer side.

    Args:
        change, error: of the cells in the group's direction, metres (rows, columns).
        usable: cells that a disc may hold.
        own: cells of the group.
    """
    rows, columns = np.nonzero(own)
    longest = max(np.ptp(rows), np.ptp(columns)) / 2.0 + 0.5
    values = np.stack([np.where(usable, change, 0.0), np.where(usable, error, 0.0) ** 2], axis=-1)
    row, column = np.indices(own.shape)
    for step in range(1 + math.ceil(max(math.log(longest, _STEP), 0.0))):
        radius = _STEP**step
        reach = np.arange(-int(radius), int(radius) + 1)
        total, variance = mask_sums(values, np.hypot(reach[:, None], reach) <= radius)[own].T
        best = int(np.argmax(total / np.sqrt(np.maximum(variance, values[own, 1]))))
        inside = np.hypot(row - rows[best], column - columns[best]) <= radius
        yield (inside & usable).astype(np.float64)


def log_of_discs(compared: int) -> float:
    """Logarithm of how many discs a map of ``compared`` cells has: one of each radius about every cell."""
    radii = 1.0 + max(math.log(math.sqrt(compared), _STEP), 0.0)
    return math.log(compared * radii)
