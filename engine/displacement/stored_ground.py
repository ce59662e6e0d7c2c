"""Ground points of a survey that stay on the disk, from which what motion along the surface needs is read by places.

Whatever is taken at a place depends on the points there and on their order in the cloud, so that it has the same bytes
as with all points in memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Bool, Float
from ..core.errors import InputError
from ..geometry.columns import greatest, least
from ..pointcloud.in_parts import SpooledCloud
from ..pointcloud.point_squares import Box, PointSquares
from .frame import Frame

_EDGE_M = 0.01  # beyond what is asked for, so that no rounding leaves out a point
_LEAST_BOX_M = 0.5


@dataclass(frozen=True)
class StoredGround:
    """A survey's ground in a file.

    Attributes:
        cloud: the points in their order; ``squares`` are the same, sorted by places.
        low, high: (rows, columns) lowest and highest z of each square, metres; infinite and minus infinite without.
        at_once: points that may be in memory at a time.
    """

    cloud: SpooledCloud
    squares: PointSquares
    low: Float
    high: Float
    at_once: int

    @classmethod
    def of(cls, cloud: SpooledCloud, at_once: int) -> StoredGround:
        """Sort the points of a cloud, n > 0, into a file next to its own."""
        squares = PointSquares.of(cloud)
        low, high = np.full(squares.shape, np.inf), np.full(squares.shape, -np.inf)
        for xyz, _ in cloud.parts():
            column, row = (
                np.clip(np.floor((xyz[:, k] - squares.low[k]) / squares.side).astype(np.int64), 0, last - 1)
                for k, last in ((0, squares.shape[1]), (1, squares.shape[0]))
            )
            np.minimum.at(low, (row, column), xyz[:, 2])
            np.maximum.at(high, (row, column), xyz[:, 2])
        return cls(cloud, squares, low, high, at_once)

    def __len__(self) -> int:
        return len(self.cloud)

    @property
    def area(self) -> float:
        """Of the squares that have points, m²; at least that of the ground."""
        return float(np.count_nonzero(np.isfinite(self.low))) * self.squares.side**2

    def holding(self, at_once: int) -> StoredGround:
        """The same with another number of points that may be in memory at a time."""
        return replace(self, at_once=at_once)

    def parts(self) -> Iterator[Float]:
        """The points (n, 3) in their order."""
        for xyz, _ in self.cloud.parts():
            yield xyz

    def within(self, box: Box) -> Float:
        """The points (n, 3) in a box on the map, in the cloud's order."""
        return np.ascontiguousarray(self.squares.within(box)["xyz"])

    def in_plane(self, frame: Frame, low: Float, high: Float) -> Float:
        """The points (n, 3) between ``low`` and ``high`` (2,) along the first two axes of a frame, in their order.

        Raises:
            InputError: they are more than may be in memory at a time.
        """
        taken, numbers, count = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)], 0
        for box in self._boxes_over(frame, low, high):
            found = self.squares.within(box)
            xyz = np.ascontiguousarray(found["xyz"])
            inside = between(in_frame(frame, xyz), low, high)
            taken.append(xyz[inside])
            numbers.append(found["number"][inside].astype(np.int64))
            count += len(numbers[-1])
            if count > self.at_once:
                raise too_dense(self.at_once)
        return np.concatenate(taken)[np.argsort(np.concatenate(numbers), kind="stable")]

    def _boxes_over(self, frame: Frame, low: Float, high: Float) -> Iterator[Box]:
        """Boxes on the map that together hold all points between ``low`` and ``high`` along a frame's axes."""
        rows, columns = np.nonzero(np.isfinite(self.low))
        side, corner = self.squares.side, self.squares.low
        middle = np.column_stack([
            corner[0] + (columns + 0.5) * side,
            corner[1] + (rows + 0.5) * side,
            (self.low[rows, columns] + self.high[rows, columns]) / 2,
        ])  # fmt: skip
        half = np.column_stack([
            np.full((len(rows), 2), side / 2), (self.high[rows, columns] - self.low[rows, columns]) / 2
        ]) + _EDGE_M  # fmt: skip
        flat, reach = frame.to_plane(middle)[:, :2], half @ np.abs(frame.axes[:2]).T
        near = ((flat + reach >= low) & (flat - reach <= high)).all(axis=1)
        if not near.any():
            return
        west, south = (float(corner[k] + side * n[near].min()) for k, n in ((0, columns), (1, rows)))
        east, north = (float(corner[k] + side * (n[near].max() + 1)) for k, n in ((0, columns), (1, rows)))
        yield from self.readable(Box(west, south, east, north).grown(_EDGE_M))

    def readable(self, root: Box, reach: float = 0.0) -> Iterator[Box]:
        """A box in parts around each of which, ``reach`` metres far, no more points lie than may be in memory.

        Raises:
            InputError: even the smallest parts have more.
        """
        waiting = [root]
        while waiting:
            box = waiting.pop()
            if self.squares.count(box.grown(reach)) <= self.at_once:
                yield box
            elif max(box.east - box.west, box.north - box.south) < _LEAST_BOX_M:
                raise too_dense(self.at_once)
            else:
                waiting += box.halves()[::-1]


Ground = Float | StoredGround
"""Ground points (n, 3) in memory, or on the disk."""


def too_dense(at_once: int) -> InputError:
    """What is said where the points of one place do not fit."""
    return InputError(
        f"The memory allowed holds {at_once:,} points of a survey at a time, and more lie within the reach of one "
        "tile of windows; raise --memory-limit or thin the clouds."
    )


def between(points: Float, low: Float, high: Float) -> Bool:
    """Which of the points (n, 2+) lie from ``low`` to ``high`` (2,) along the first two axes, (n,)."""
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))


def in_frame(frame: Frame, xyz: Float) -> Float:
    """As ``frame.to_plane``; a point alone has the digits that it has among others, too."""
    return frame.to_plane(np.concatenate([xyz, xyz]))[:1] if len(xyz) == 1 else frame.to_plane(xyz)


def bounds_of(ground: Ground) -> tuple[Float, Float]:
    """Lowest and highest coordinates, (3,) each."""
    return ground.cloud.bounds if isinstance(ground, StoredGround) else (least(ground), greatest(ground))


def parts_of(ground: Ground) -> Iterator[Float]:
    """The points (n, 3) part by part; in one, where they are in memory."""
    if isinstance(ground, StoredGround):
        yield from ground.parts()
    else:
        yield ground
