"""Sums over square windows around the parts of a grid, each as wide as suits the part."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Bool, Float, Index
from ..statistics.layout import Layout
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
    layout = partition.layout
    if partition.block is None:
        reach, whole = max(window, least), layout.on_grid(values.astype(np.float64), 0.0)
        total: Float = layout.of(ndimage.uniform_filter(whole, reach, mode="constant") * reach**2)
        return np.rint(total) if values.dtype == np.bool_ else total
    inside = partition.block >= 0
    number = partition.block[inside]
    weight = np.zeros(partition.block.shape)
    weight[inside] = values[inside] / partition.cells[number]
    result = np.zeros(partition.count)
    with_cells = partition.cells > 0
    if math.prod(partition.shape) <= _BAND:
        weight, layout = layout.on_grid(weight, 0.0), Layout(partition.shape)
    for width in np.unique(partition.width[with_cells]):
        reach = max(2 * (window * int(width) // 2) + 1, least)
        middle = np.sort(partition.middle[with_cells & (partition.width == width)])
        result[partition.block.ravel()[middle]] = _sums_at(
            weight, layout, reach, *partition.layout.row_and_column(middle)
        )
    around = np.zeros(partition.block.shape)
    around[inside] = result[number]
    return around


def _sums_at(weight: Float, layout: Layout, reach: int, row: Index, column: Index) -> Float:
    """Sums over the windows of ``reach`` cells around the cells in the rows and columns (n,), in rows' order.

    Large grids are laid out where these are only.
    """
    if weight.ndim == 2 and weight.size <= _BAND:
        whole: Float = ndimage.uniform_filter(weight, reach, mode="constant")[row, column] * reach**2
        return whole
    sums = np.empty(row.size)
    height = max(_BAND // layout.shape[1], 2 * reach)
    for top in range(0, layout.shape[0], height):
        here = slice(*np.searchsorted(row, (top, top + height)).tolist())
        if here.start == here.stop:
            continue
        first = max(top - reach, 0), max(int(column[here].min()) - reach, 0)
        last = top + height + reach, int(column[here].max()) + reach + 1
        part = layout.window(weight, (slice(first[0], last[0]), slice(first[1], last[1])), 0.0)
        total = ndimage.uniform_filter(part, reach, mode="constant") * reach**2
        sums[here] = total[row[here] - first[0], column[here] - first[1]]
    return sums


@dataclass(frozen=True)
class PartWindows:
    """Windows around the parts of the cells ``here`` (n,), their indices in ascending order, all of them in parts.

    They are ``least`` cells wide, or more where a part and its neighbours take more.
    """

    partition: Partition
    here: Index
    least: int

    def totals(self, *fields: NDArray[Any]) -> list[NDArray[Any]]:
        """Sum over the windows, (n,), of each of ``fields`` (n,), in which a part counts with its mean."""
        if not self.partition.grown:
            flat = self._layout.flat(self.here)
            return self._windows(self.least).totals(flat, *fields)
        return [
            sums_around(self.partition, self._laid_out(field), _OWN_SIDES, self.least).ravel()[self.here]
            for field in fields
        ]

    def reached(self, chosen: Bool) -> Bool:
        """Which of the cells, (n,), are near one of the ``chosen`` (n,), or in a part with such a cell."""
        if self.partition.block is None:
            return self._windows(self.least).any(self._layout.flat(self.here[chosen]))
        number = self.partition.block.ravel()[self.here]
        width = self.partition.width[number]
        near = np.zeros(self.here.size, dtype=bool)
        for multiple in np.unique(width[chosen]):
            of_width = self._layout.flat(self.here[chosen & (width == multiple)])
            near |= self._windows(max(2 * int(multiple) + 1, self.least)).any(of_width)
        touched = np.zeros(self.partition.count, dtype=bool)
        touched[number[near]] = True
        return touched[number]

    @property
    def _layout(self) -> Layout:
        return self.partition.layout

    def _windows(self, size: int) -> Windows:
        least = size if self.partition.grown else max(size, MIN_WINDOW_CELLS)
        return Windows(self._layout.flat(self.here), self.partition.shape, least // 2)

    def _laid_out(self, values: NDArray[Any]) -> NDArray[Any]:
        cells = np.zeros(self._layout.array_shape, dtype=values.dtype)
        cells.ravel()[self.here] = values
        return cells
