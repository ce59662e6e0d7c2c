"""Points counted by square, from parts of a cloud."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..core.arrays import Index


def counted(parts: Iterable[Index]) -> tuple[Index, Index]:
    """The numbers that occur in parts (n,) of a cloud, ascending, and how often each does, (m,) each."""
    numbers, counts = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    for part in parts:
        found, of_part = np.unique(part, return_counts=True)
        if not len(numbers):
            numbers, counts = found, of_part
            continue
        numbers, place = np.unique(np.concatenate([numbers, found]), return_inverse=True)
        counts = np.bincount(place.ravel(), np.concatenate([counts, of_part]), len(numbers)).astype(np.int64)
    return numbers, counts


def counted_squares(parts: Iterable[Index]) -> tuple[Index, Index]:
    """Column and row (m, 2) of each square that holds points, none negative, and the points (m,) in it.

    Args:
        parts: columns and rows (n, 2) of the points.
    """
    keys, counts = counted((part[:, 0] << 32) + part[:, 1] for part in parts)
    return np.column_stack([keys >> 32, keys & 0xFFFFFFFF]), counts
