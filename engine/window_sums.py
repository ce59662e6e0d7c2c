"""Sums over square windows of cells, from running sums: exact, and as fast for large windows as for small ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Whole = NDArray[np.signedinteger[Any]]


@dataclass(frozen=True)
class Windows:
    """Windows around cells, cut at the grid's edges, as places of their corners in the tables of ``RunningSums``."""

    upper_left: NDArray[np.intp]
    upper_right: NDArray[np.intp]
    lower_left: NDArray[np.intp]
    lower_right: NDArray[np.intp]


def windows_around(row: NDArray[np.intp], column: NDArray[np.intp], radius: int, shape: tuple[int, int]) -> Windows:
    """Windows of 2 ``radius`` + 1 cells a side around the cells ``row``, ``column`` (n,) of a grid (rows, columns)."""
    line = shape[1] + 1
    upper = np.maximum(row - radius, 0) * line
    lower = np.minimum(row + (radius + 1), shape[0]) * line
    left, right = np.maximum(column - radius, 0), np.minimum(column + (radius + 1), shape[1])
    return Windows(upper + left, upper + right, lower + left, lower + right)


class RunningSums:
    """Summed-area tables (Crow 1984, doi:10.1145/800031.808600) of fields of whole numbers over one grid.

    Whole numbers because they add up exactly, even where a running sum overflows: it counts modulo 2^32 or 2^64, and
    so does the difference that is the sum over a window. Only that itself must fit (see ``fixed_point``).
    """

    def __init__(self, fields: Sequence[Whole]) -> None:
        """Of ``fields``, each (rows, columns), of one type."""
        rows, columns = fields[0].shape
        tables = np.zeros((len(fields), rows + 1, columns + 1), dtype=fields[0].dtype)
        for table, field in zip(tables, fields, strict=True):
            np.cumsum(field, axis=1, dtype=table.dtype, out=table[1:, 1:])
        for above, row in pairwise(tables.swapaxes(0, 1)):  # much faster than numpy's sum along this axis
            np.add(row, above, out=row)
        self._tables = tables.reshape(len(fields), -1)

    def totals(self, windows: Windows) -> list[Whole]:
        """Sum of each field over each window (n,)."""
        found: list[Whole] = []
        for table in self._tables:
            total = table.take(windows.lower_right)
            total -= table.take(windows.lower_left)
            total -= table.take(windows.upper_right)
            total += table.take(windows.upper_left)
            found.append(total)
        return found


def fixed_point(values: Float, largest: float) -> tuple[NDArray[np.int64], float]:
    """``values`` (finite) in whole units, and the unit: the power of two with which sums up to ``largest`` fit."""
    unit = 2.0 ** (math.ceil(math.log2(max(largest, 1e-30))) - 62)
    return np.rint(values * (1.0 / unit)).astype(np.int64), unit
