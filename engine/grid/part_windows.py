"""Sums over square windows around the parts of a grid, each as wide as suits the part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Bool, Float, Index
from ..statistics.window_sums import Windows
from .partition import Partition

_BAND = 4_000_000  # cells that are summed around at a time
_OWN_SIDES = 3  # of a grown part, at least: it and its neighbours
MIN_WINDOW_CELLS = 5
"""Along the side of a window around a cell."""


def sums_around(partition: Partition, values: NDArray[Any], window: int, least: int = 1) -> Float:
    """Sum over the parts around each cell's part, in a window of ``window`` of its own sides or ``least`` cells.

    A part counts with the mean of its cells' ``values`` (rows, columns; or with 1 for True), times the part of its
    cells that is in the window. The window lies around the part's middle cell; its own part is in it. Cells in no part
    get and count nothing.
    """
    if partition.block is None:
        reach = max(window, least)
        total: Float = ndimage.uniform_filter(values.astype(np.float64), reach, mode="constant") * reach**2
        return np.rint(total) if values.dtype == np.bool_ else total
    inside = partition.block >= 0
    number = partition.block[inside]
    weight = np.zeros(partition.shape)
    weight[inside] = values[inside] / partition.cells[number]
    result = np.zeros(partition.count)
    with_cells = partition.cells > 0
    for width in np.unique(partition.width[with_cells]):
        reach = max(2 * (window * int(width) // 2) + 1, least)
        middle = np.sort(partition.middle[with_cells & (partition.width == width)])
        result[partition.block.ravel()[middle]] = _sums_at(weight, reach, *np.divmod(middle, partition.shape[1]))
    around = np.zeros(partition.shape)
    around[inside] = result[number]
    return around


def _sums_at(weight: Float, reach: int, row: Index, column: Index) -> Float:
    """Sums over the windows of ``reach`` cells around the places (n,), in rows' order, where these are only."""
    if weight.size <= _BAND:
        whole: Float = ndimage.uniform_filter(weight, reach, mode="constant")[row, column] * reach**2
        return whole
    sums = np.empty(row.size)
    height = max(_BAND // weight.shape[1], 2 * reach)
    for top in range(0, weight.shape[0], height):
        here = slice(*np.searchsorted(row, (top, top + height)).tolist())
        if here.start == here.stop:
            continue
        first = max(top - reach, 0), max(int(column[here].min()) - reach, 0)
        last = top + height + reach, int(column[here].max()) + reach + 1
        part = weight[first[0] : last[0], first[1] : last[1]]
        total = ndimage.uniform_filter(part, reach, mode="constant") * reach**2
        sums[here] = total[row[here] - first[0], column[here] - first[1]]
    return sums


@dataclass(frozen=True)
class PartWindows:
    """Windows around the parts of the cells ``here`` (n,), flat indices in ascending order, all of them in parts.

    They are ``least`` cells wide, or more where a part and its neighbours take more.
    """

    partition: Partition
    here: Index
    least: int

    def totals(self, *fields: NDArray[Any]) -> list[NDArray[Any]]:
        """Sum over the windows, (n,), of each of ``fields`` (n,), in which a part counts with its mean."""
        if not self.partition.grown:
            return self._windows.totals(self.here, *fields)
        return [
            sums_around(self.partition, self._on_grid(field), _OWN_SIDES, self.least).ravel()[self.here]
            for field in fields
        ]

    def reached(self, chosen: Bool) -> Bool:
        """Which of the cells, (n,), are near one of the ``chosen`` (n,), or in a part with such a cell."""
        if self.partition.block is None:
            return self._windows.any(self.here[chosen])
        number = self.partition.block.ravel()[self.here]
        width = self.partition.width[number]
        near = np.zeros(self.here.size, dtype=bool)
        for multiple in np.unique(width[chosen]):
            grid = self._on_grid(chosen & (width == multiple))
            size = max(2 * int(multiple) + 1, self.least)
            near |= ndimage.maximum_filter(grid, size=size).ravel()[self.here]
        touched = np.zeros(self.partition.count, dtype=bool)
        touched[number[near]] = True
        return touched[number]

    @property
    def _windows(self) -> Windows:
        return Windows(self.here, self.partition.shape, max(self.least, MIN_WINDOW_CELLS) // 2)

    def _on_grid(self, values: NDArray[Any]) -> NDArray[Any]:
        grid = np.zeros(self.partition.shape, dtype=values.dtype)
        grid.ravel()[self.here] = values
        return grid
