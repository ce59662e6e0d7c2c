"""Which points of a cloud can lie in a cylinder or a ball: candidates by the cells of the cloud's own plane.

A surface seen along its dominant plane's normal is thin: all that a cylinder across it can hold lies in the cells that
the cylinder covers in that plane. The points are sorted by these cells once, so that a cylinder's candidates are a few
runs of neighbouring points. What lies within is for the caller to test; nothing within is ever left out.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Index = NDArray[np.int64]

CELLS_A_RADIUS = 2.0  # measured: finer cells fit the cylinder better, but take more looking up
_PAIRS = 1_000_000  # pairs of a place and a point held at a time; some 150 bytes each
_RUNS = 500_000  # rows of cells looked up at a time
_SAMPLE = 100_000


def dominant_frame(xyz: Float) -> Float:
    """Rows (3, 3): two axes in the plane that fits the points (n, 3) best, and its normal, which points upwards."""
    some = xyz[:: max(1, len(xyz) // _SAMPLE)]
    local = some - some.mean(axis=0)
    _, vectors = np.linalg.eigh(local.T @ local)
    u, w = vectors[:, 2], vectors[:, 0]
    w = w if w[2] >= 0 else -w
    return np.stack([u, np.cross(w, u), w])


class Lattice:
    """Points sorted by square cells of the plane that ``frame`` (see ``dominant_frame``) spans.

    ``points`` (3, n), x, y and z by themselves, are in that order.
    """

    def __init__(self, xyz: Float, radius: float, frame: Float | None = None) -> None:
        """Sort ``xyz`` (n, 3), n > 0, for searches of about ``radius``."""
        self.frame = dominant_frame(xyz) if frame is None else frame
        self.cell = radius / CELLS_A_RADIUS
        self._origin = xyz[0].copy()
        self._digits = 16 * np.finfo(np.float64).eps * float(np.abs(xyz).max())
        plane = self._in_plane(xyz)
        self._low = plane.min(axis=0)
        spans = np.floor((plane.max(axis=0) - self._low) / self.cell) + 1
        if spans.prod() > 2.0**62:
            # so few points in so many cells: larger cells do as well
            self.cell *= float(spans.max()) / 2.0**30
            spans = np.floor((plane.max(axis=0) - self._low) / self.cell) + 1
        self._columns, self._rows = (int(s) for s in spans)
        column, row = np.floor((plane - self._low) / self.cell).astype(np.int64).T
        key = row * self._columns + column
        order = np.argsort(key, kind="stable")
        self._key = key[order]
        self.points = np.ascontiguousarray(xyz[order].T)

    def candidates(self, places: Float, half_axes: Float, radius: float) -> Iterator[tuple[Index, Index]]:
        """Pairs (number of a place, number of a point) that hold every point within ``radius`` of a place's segment.

        Points are numbered as in ``points``. A segment runs from ``place - half_axis`` to ``place + half_axis``; a ball
        is one of no length.
        All pairs of a place are in one yield, one after the other; places without any pair are left out.

        Args:
            places: (m, 3).
            half_axes: (m, 3).
        """
        place, axis = self._in_plane(places), half_axes @ self.frame[:2].T
        length = float(np.abs(axis).max(initial=0.0))
        reach = radius + 1e-9 * (radius + length) + self._digits
        low = (place[:, 1] - np.abs(axis[:, 1]) - reach - self._low[1]) / self.cell
        high = (place[:, 1] + np.abs(axis[:, 1]) + reach - self._low[1]) / self.cell
        first = np.clip(np.floor(low), 0, self._rows).astype(np.int64)
        last = np.clip(np.floor(high), -1, self._rows - 1).astype(np.int64)
        rows = np.maximum(last - first + 1, 0)
        # neighbours in the plane one after the other, for the sake of the processor's cache
        column = np.clip(np.floor((place[:, 0] - self._low[0]) / self.cell), 0, self._columns - 1).astype(np.int64)
        order = np.lexsort((column, (first + last) // 2))
        for part in _parts(rows[order], _RUNS):
            chosen = order[part]
            chosen = chosen[rows[chosen] > 0]
            number = np.repeat(chosen, rows[chosen])
            row = np.repeat(first[chosen], rows[chosen]) + _count_up(rows[chosen])
            start, stop = self._runs(row, place[number], axis[number], reach)
            held = np.bincount(np.repeat(np.arange(len(chosen)), rows[chosen]), stop - start, len(chosen))
            ends = np.cumsum(rows[chosen])
            for few in _parts(held.astype(np.int64), _PAIRS):
                runs = slice(ends[few.start] - rows[chosen[few.start]], ends[few.stop - 1])
                size = stop[runs] - start[runs]
                if size.any():
                    yield np.repeat(number[runs], size), np.repeat(start[runs], size) + _count_up(size)

    def offsets(self, places: Float, number: Index, point: Index) -> tuple[Float, Float, Float]:
        """x, y and z of the points from their places (m, 3), for pairs as ``candidates`` gives them.

        The difference of two coordinates is taken before anything else, so that large ones cost no digits.
        """
        x, y, z = (self.points[axis][point] - places[:, axis][number] for axis in range(3))
        return x, y, z

    def _in_plane(self, xyz: Float) -> Float:
        return (xyz - self._origin) @ self.frame[:2].T

    def _runs(self, row: Index, place: Float, axis: Float, reach: float) -> tuple[Index, Index]:
        """First and one past the last of the sorted points in each row of cells that a place's segment reaches."""
        below = row * self.cell + self._low[1] - place[:, 1]
        above = below + self.cell
        rise = np.abs(axis[:, 1])
        # the part of the segment, from -1 to 1 of its half length, that is near enough to the row
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(below - reach) / axis[:, 1], (above + reach) / axis[:, 1]])
        ends = np.where(axis[:, 1] == 0, [[-1.0], [1.0]], np.clip(np.sort(ends, axis=0), -1.0, 1.0))
        gap = np.maximum(0.0, np.maximum(below - rise, -rise - above))
        width = np.sqrt(np.maximum(reach**2 - gap**2, 0.0))
        reached = place[:, 0] + ends * axis[:, 0]
        left = np.floor((reached.min(axis=0) - width - self._low[0]) / self.cell - 1e-9)
        right = np.floor((reached.max(axis=0) + width - self._low[0]) / self.cell + 1e-9)
        left = np.clip(left, 0, self._columns).astype(np.int64)
        right = np.clip(right, -1, self._columns - 1).astype(np.int64)
        start = np.searchsorted(self._key, row * self._columns + left, side="left")
        stop = np.searchsorted(self._key, row * self._columns + right, side="right")
        return start, np.maximum(start, stop)


def _count_up(sizes: Index) -> Index:
    """0, 1, ... size - 1 for each size, one after the other."""
    ends = np.cumsum(sizes)
    return np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - sizes, sizes)


def _parts(sizes: Index, limit: int) -> Iterator[slice]:
    """Consecutive slices whose sizes sum to at most ``limit``, or that have one member."""
    ends = np.cumsum(sizes)
    start = 0
    while start < len(sizes):
        before = int(ends[start - 1]) if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, before + limit, side="right")))
        yield slice(start, stop)
        start = stop
