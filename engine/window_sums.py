"""Sums over square windows of cells, from running sums: exact, and as fast for large windows as for small ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True)
class Windows:
    """Windows around cells, cut at the grid's edges, as places of their corners in a ``RunningSums``."""

    upper_left: Whole
    upper_right: Whole
    lower_left: Whole
    lower_right: Whole


class RunningSums:
    """Summed-area tables (Crow 1984, doi:10.1145/800031.808600) of fields of whole numbers over one grid.

    Whole numbers because they add up exactly, even where a running sum overflows: it counts modulo 2^64, and so does
    the difference that is the sum over a window. Only that sum itself must stay below 2^63 (see ``fixed_point``).
    """

    def __init__(self, fields: Sequence[Whole]) -> None:
        """Of ``fields``, each (rows, columns)."""
        self._rows, self._columns = fields[0].shape
        tables = np.zeros((self._rows + 1, len(fields), self._columns + 1), dtype=np.int64)
        for number, field in enumerate(fields):
            np.cumsum(field, axis=1, out=tables[1:, number, 1:])
        for row in range(1, self._rows + 1):  # much faster than numpy's sum along the first axis
            tables[row] += tables[row - 1]
        self._line = len(fields) * (self._columns + 1)
        self._flat = tables.ravel()

    def windows(self, row: Whole, column: Whole, radius: int) -> Windows:
        """Windows of 2 ``radius`` + 1 cells a side around the cells ``row``, ``column`` (n,)."""
        upper = np.maximum(row - radius, 0) * self._line
        lower = np.minimum(row + (radius + 1), self._rows) * self._line
        left, right = np.maximum(column - radius, 0), np.minimum(column + (radius + 1), self._columns)
        return Windows(upper + left, upper + right, lower + left, lower + right)

    def total(self, number: int, windows: Windows) -> Whole:
        """Sum of the field ``number`` over each window (n,)."""
        table = self._flat[number * (self._columns + 1) :]
        total: Whole = table.take(windows.lower_right)
        total -= table.take(windows.lower_left)
        total -= table.take(windows.upper_right)
        total += table.take(windows.upper_left)
        return total


def fixed_point(values: Float, largest: float) -> tuple[Whole, float]:
    """``values`` (finite) in whole units, and the unit: the power of two with which sums up to ``largest`` fit."""
    unit = 2.0 ** (math.ceil(math.log2(max(largest, 1e-30))) - 62)
    return np.rint(values * (1.0 / unit)).astype(np.int64), unit
