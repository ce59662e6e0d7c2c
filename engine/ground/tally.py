"""Counts by number, gathered from parts of a cloud."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float, Index

_MAX_PENDING = 1_000_000
"""Numbers that wait to be merged with the others."""


class Tally:
    """Sums of rows of values by number (a square, a box), kept once for each number."""

    def __init__(self, rows: int = 1) -> None:
        self._numbers: list[Index] = [np.zeros(0, dtype=np.int64)]
        self._sums: list[Float] = [np.zeros((rows, 0))]
        self._pending = 0

    def add(self, numbers: Index) -> None:
        """Count each of the numbers (n,)."""
        found, counts = np.unique(numbers, return_counts=True)
        self.add_sums(found, counts[None].astype(np.float64))

    def add_sums(self, numbers: Index, sums: Float) -> None:
        """Add the columns of ``sums`` (rows, m) to those of ``numbers`` (m,)."""
        self._numbers.append(numbers)
        self._sums.append(sums)
        self._pending += len(numbers)
        if self._pending > max(_MAX_PENDING, len(self._numbers[0])):
            self._merge()

    def found(self) -> tuple[Index, Float]:
        """The numbers (m,), ascending, and their sums (rows, m)."""
        self._merge()
        return self._numbers[0], self._sums[0]

    def counts(self) -> Float:
        """(m,) the sums of the first row, in the order of the numbers."""
        return self.found()[1][0]

    def _merge(self) -> None:
        numbers, place = np.unique(np.concatenate(self._numbers), return_inverse=True)
        together = np.hstack(self._sums)
        sums = np.asarray([np.bincount(place.ravel(), row, len(numbers)) for row in together], dtype=np.float64)
        self._numbers, self._sums, self._pending = [numbers], [sums], 0


def square_keys(places: Index) -> Index:
    """(n,) one number for each column and row (n, 2), which may be negative."""
    return np.asarray((places[:, 0] << 32) + places[:, 1], dtype=np.int64)


def metre_squares(points: Float) -> Index:
    """(n,) number of the square of a metre that each of the points (n, 2+) lies in."""
    return square_keys(np.floor(points[:, :2]).astype(np.int64))


def square_places(keys: Index) -> Index:
    """(n, 2) the columns and rows of ``square_keys``."""
    rows = ((keys & 0xFFFFFFFF) + (1 << 31) & 0xFFFFFFFF) - (1 << 31)
    return np.column_stack([(keys - rows) >> 32, rows])
