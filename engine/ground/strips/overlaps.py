"""Where strips of one survey lie over one another: their heights above the same cells, in moments that add up."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Index

MIN_POINTS = 4
"""Of a strip in a cell, at least."""
_MIN_FREEDOM = 3
_MAX_GRADIENT = 2.0
"""Heights of steeper ground say little about strips."""


@dataclass(frozen=True)
class StripPoints:
    """Ground points ``xyz`` (n, 3) of one survey in metres, with ``strip`` (n,) from 0 and ``seconds`` (n,)."""

    xyz: Float
    strip: Index
    seconds: Float


@dataclass(frozen=True)
class Overlaps:
    """Pairs of strips over one cell, (n,) each: strip ``first`` lies ``height`` m over strip ``second``.

    ``gradient`` (n, 2) is the ground's in x and y, ``variance`` that of the height's noise (m²), ``seconds`` (n, 2) the
    mean times of both, ``place`` (n, 2) the middle of the cell.
    """

    first: Index
    second: Index
    height: Float
    gradient: Float
    variance: Float
    seconds: Float
    place: Float

    def __len__(self) -> int:
        return len(self.height)

    def chosen(self, which: Index | np.ndarray) -> Overlaps:
        return Overlaps(*(values[which] for values in vars(self).values()))


class Moments:
    """Sums over the points of each strip in each cell of ``cell`` m, gathered part by part."""

    def __init__(self, cell: float, corner: Float, columns: int, strips: int) -> None:
        self.cell, self.corner, self.columns, self.strips = cell, corner, columns, strips
        self.key = np.empty(0, dtype=np.int64)
        self.sums = np.empty((0, _SUMS))

    def add(self, points: StripPoints) -> None:
        """Take some more points."""
        place = points.xyz - self.corner
        column, row = (np.floor(place[:, k] / self.cell).astype(np.int64) for k in (0, 1))
        middle = (np.column_stack([column, row]) + 0.5) * self.cell
        x, y = (place[:, :2] - middle).T
        z, t = place[:, 2], points.seconds
        key = (row * self.columns + column) * self.strips + points.strip
        found, number = np.unique(key, return_inverse=True)
        terms = (np.ones(len(x)), x, y, z, t, x * x, x * y, y * y, x * z, y * z, z * z)
        sums = np.column_stack([np.bincount(number, values, minlength=len(found)) for values in terms])
        merged, place_of = np.unique(np.concatenate([self.key, found]), return_inverse=True)
        total = np.zeros((len(merged), _SUMS))
        np.add.at(total, place_of, np.concatenate([self.sums, sums]))
        self.key, self.sums = merged, total

    def overlaps(self) -> Overlaps:
        """All pairs of strips over the same cells."""
        enough = self.sums[:, 0] >= MIN_POINTS
        key, sums = self.key[enough], self.sums[enough]
        cell, strip = key // self.strips, key % self.strips
        _, number, held = np.unique(cell, return_inverse=True, return_counts=True)
        several = held[number] > 1
        key, sums, cell, strip = key[several], sums[several], cell[several], strip[several]
        if not len(key):
            return Overlaps(*(np.empty(0, np.int64),) * 2, *(np.empty((0, *s)) for s in ((), (2,), (), (2,), (2,))))
        _, number = np.unique(cell, return_inverse=True)
        gradient, noise, good = _planes(sums, number)
        count = sums[:, 0]
        mean = sums[:, 1:5] / count[:, None]
        # Height of each strip in the middle of the cell, and what its scatter and its gradient's make of its error.
        height = mean[:, 2] - (gradient[number] * mean[:, :2]).sum(axis=1)
        one, two = _pairs(number)
        keep = good[number[one]]
        one, two = one[keep], two[keep]
        middle = np.column_stack([cell % self.columns, cell // self.columns]) + 0.5
        return Overlaps(
            strip[one],
            strip[two],
            height[one] - height[two],
            gradient[number[one]],
            noise[number[one]] * (1 / count[one] + 1 / count[two]),
            np.column_stack([mean[one, 3], mean[two, 3]]),
            middle[one] * self.cell + self.corner[:2],
        )


_SUMS = 11


def _planes(sums: Float, number: Index) -> tuple[Float, Float, np.ndarray]:
    """Common gradient (k, 2) and variance (k,) of the points about it in each cell, and whether both are known."""
    count = sums[:, 0]
    x, y, z = (sums[:, k] / count for k in (1, 2, 3))
    within = (
        sums[:, 5] - count * x * x,
        sums[:, 6] - count * x * y,
        sums[:, 7] - count * y * y,
        sums[:, 8] - count * x * z,
        sums[:, 9] - count * y * z,
        sums[:, 10] - count * z * z,
        count,
        np.ones(len(count)),
    )
    xx, xy, yy, xz, yz, zz, points, strips = (np.bincount(number, values) for values in within)
    determinant = xx * yy - xy**2
    freedom = points - strips - 2
    good = (freedom >= _MIN_FREEDOM) & (determinant > 0.02 * (xx + yy) ** 2)
    safe = np.where(good, determinant, 1.0)
    gradient = np.column_stack([(xz * yy - yz * xy) / safe, (yz * xx - xz * xy) / safe])
    noise = (zz - gradient[:, 0] * xz - gradient[:, 1] * yz) / np.maximum(freedom, 1)
    good &= np.hypot(*gradient.T) < _MAX_GRADIENT
    return gradient, np.maximum(noise, 1e-8), good


def _pairs(number: Index) -> tuple[Index, Index]:
    """All pairs of entries with the same ``number`` (n,), which rises."""
    one, two = [], []
    start = np.searchsorted(number, np.arange(number[-1] + 2))
    largest = int(np.diff(start).max())
    for lag in range(1, largest):
        first = np.flatnonzero(number[:-lag] == number[lag:])
        one.append(first)
        two.append(first + lag)
    return np.concatenate(one), np.concatenate(two)


def gathered(parts: Iterable[StripPoints], moments: Moments) -> Overlaps:
    """The overlaps of all ``parts``."""
    for part in parts:
        moments.add(part)
    return moments.overlaps()
