"""A cloud on the disk, sorted by squares seen from above, so that the points of any box are read by themselves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Bool, Float, Index
from .in_parts import SpooledCloud

_SQUARE_POINTS = 5_000  # about so many points of a square; fewer make more places to read a box from
_MIN_SIDE_M = 5.0
_MAX_SQUARES = 4_000_000  # a stray point far away makes many empty ones
_SAMPLE_POINTS = 100_000


@dataclass(frozen=True)
class Box:
    """Seen from above, metres; its western and southern edges belong to it."""

    west: float
    south: float
    east: float
    north: float

    def grown(self, reach: float) -> Box:
        """The box with so many metres more on all sides."""
        return Box(self.west - reach, self.south - reach, self.east + reach, self.north + reach)

    def holds(self, xyz: Float) -> Bool:
        """Which of the points (n, 2+) lie in it, (n,)."""
        x, y = xyz[:, 0], xyz[:, 1]
        return np.asarray((x >= self.west) & (x < self.east) & (y >= self.south) & (y < self.north))

    def distance(self, xyz: Float) -> Float:
        """Distances (n,) of places (n, 2+) from it, seen from above; 0 within."""
        x, y = xyz[:, 0], xyz[:, 1]
        across = np.maximum(np.maximum(self.west - x, x - self.east), 0.0)
        return np.hypot(across, np.maximum(np.maximum(self.south - y, y - self.north), 0.0))

    def halves(self) -> tuple[Box, Box]:
        """It cut across its longer side."""
        if self.east - self.west >= self.north - self.south:
            middle = (self.west + self.east) / 2
            return Box(self.west, self.south, middle, self.north), Box(middle, self.south, self.east, self.north)
        middle = (self.south + self.north) / 2
        return Box(self.west, self.south, self.east, middle), Box(self.west, middle, self.east, self.north)

    @classmethod
    def around(cls, xyz: Float) -> Box:
        """The smallest that holds all the points (n, 2+), n > 0."""
        low, high = xyz[:, :2].min(axis=0), np.nextafter(xyz[:, :2].max(axis=0), np.inf)
        return cls(float(low[0]), float(low[1]), float(high[0]), float(high[1]))


EVERYWHERE = Box(-math.inf, -math.inf, math.inf, math.inf)


@dataclass(frozen=True)
class PointSquares:
    """The points of a cloud in a file of its own, part by part of the cloud, those of a part square by square.

    Attributes:
        low: western and southern edge of the first square, m.
        shape: rows, from south to north, and columns of squares of ``side`` metres.
        parts: for each part of the cloud the numbers of its squares, ascending, and the place in the file of the first
            point of each, with the place behind the last one at the end.
        totals: (rows + 1, columns + 1) points in all squares below and to the left.
        values: how many more values each point has.
    """

    file: Path
    low: Float
    side: float
    shape: tuple[int, int]
    parts: tuple[tuple[Index, Index], ...]
    totals: Index
    values: int

    @classmethod
    def of(cls, cloud: SpooledCloud) -> PointSquares:
        """Sort the points of a cloud, n > 0, into a file next to its own."""
        low, side, shape = _squares(cloud)
        dtype, file, done = _dtype(cloud.values), cloud.file.with_suffix(".squares"), 0
        counts, parts = np.zeros(shape[0] * shape[1], dtype=np.int64), []
        with file.open("wb") as stream:
            for xyz, cover in cloud.parts():
                column, row = (
                    np.clip(np.floor((xyz[:, k] - low[k]) / side).astype(np.int64), 0, shape[1 - k] - 1) for k in (0, 1)
                )
                square = row * shape[1] + column
                order = np.argsort(square, kind="stable")
                records = np.empty(len(xyz), dtype)
                records["xyz"], records["number"] = xyz[order], done + order
                for k, values in enumerate((cover.error, cover.height)[: cloud.values] if cover else ()):
                    assert values is not None
                    records["more"][:, k] = values[order]
                records.tofile(stream)
                number, start, count = np.unique(square[order], return_index=True, return_counts=True)
                counts[number] += count
                parts.append((number, np.append(start, len(xyz)) + done))
                done += len(xyz)
        totals = np.zeros((shape[0] + 1, shape[1] + 1), dtype=np.int64)
        totals[1:, 1:] = counts.reshape(shape).cumsum(axis=0).cumsum(axis=1)
        return cls(file, low, side, shape, tuple(parts), totals, cloud.values)

    def count(self, box: Box) -> int:
        """Points in the squares that a box reaches: at least as many as are in it."""
        bottom, top, left, right = self._reached(box)
        t = self.totals
        return int(t[top, right] - t[bottom, right] - t[top, left] + t[bottom, left])

    def within(self, box: Box) -> NDArray[np.void]:
        """The points in a box in the cloud's order: ``xyz``, ``number`` in the cloud, and ``more``."""
        bottom, top, left, right = self._reached(box)
        dtype, found = _dtype(self.values), [np.zeros(0, _dtype(self.values))]
        with self.file.open("rb") as stream:
            for number, start in self.parts:
                for row in range(bottom, top):
                    first, last = np.searchsorted(number, (row * self.shape[1] + left, row * self.shape[1] + right))
                    if first == last:
                        continue
                    stream.seek(int(start[first]) * dtype.itemsize)
                    records = np.fromfile(stream, dtype, int(start[last] - start[first]))
                    found.append(records[box.holds(records["xyz"])])
        together = np.concatenate(found)
        found.clear()
        return together[np.argsort(together["number"], kind="stable")]

    def _reached(self, box: Box) -> tuple[int, int, int, int]:
        """First row and the one after the last, first column and the one after the last, of the squares of a box."""
        ends = []
        for k, (low, high) in enumerate(((box.south, box.north), (box.west, box.east))):
            last = self.shape[k] - 1
            # points at the edges of the first and of the last squares are theirs
            first, end = (np.clip(np.floor((edge - self.low[1 - k]) / self.side), 0, last) for edge in (low, high))
            ends += [int(first), int(end) + 1]
        return ends[0], ends[1], ends[2], ends[3]


def _dtype(values: int) -> np.dtype[np.void]:
    return np.dtype([("xyz", "<f8", (3,)), ("more", "<f4", (values,)), ("number", "<u4")])


def square_bytes(values: int) -> int:
    """Bytes of a point in the file."""
    return _dtype(values).itemsize


def _squares(cloud: SpooledCloud) -> tuple[Float, float, tuple[int, int]]:
    """Edge, side, rows and columns of the squares of a cloud."""
    low, high = (end[:2] for end in cloud.bounds)
    some = cloud.every(max(1, len(cloud) // _SAMPLE_POINTS))[:, :2]
    # without the few points that lie far away
    extent = np.maximum(np.quantile(some, 0.99, axis=0) - np.quantile(some, 0.01, axis=0), 1e-3)
    wanted = math.sqrt(_SQUARE_POINTS * float(np.prod(extent)) / len(cloud))
    fewest = math.sqrt(float(np.prod(np.maximum(high - low, 1e-3))) / _MAX_SQUARES)
    side = max(wanted, fewest, _MIN_SIDE_M)
    columns, rows = (int(n) + 1 for n in (high - low) // side)
    return np.array(low), side, (rows, columns)
