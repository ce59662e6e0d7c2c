"""The two clouds of M3C2: in memory, or on the disk and looked at box by box.

All that is taken at a place depends on the points near it and on the whole cloud's own frame only. So boxes with enough
around them give the same bytes as the cloud in one piece.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Bool, Float, Index
from ..core.errors import InputError
from ..geometry.columns import greatest, least
from ..pointcloud.in_parts import SpooledCloud
from ..pointcloud.point_squares import EVERYWHERE, Box, PointSquares
from .lattice import Lattice, LatticeFrame

_SMALLEST_BOX_M = 0.5


@dataclass(frozen=True)
class Near:
    """Points (n, 3) in the cloud's order, their numbers in it (n,), and each one's error by plants, if known."""

    xyz: Float
    number: Index
    values: NDArray[np.floating] | None

    def lattice(self, radius: float, frame: LatticeFrame) -> Lattice:
        return Lattice(self.xyz, radius, self.values, frame)

    def some(self, share: float) -> Near:
        """About such a share of the points, the same of a point whatever others there are."""
        if share >= 1.0:
            return self
        kept = by_chance(self.number, share)
        return Near(self.xyz[kept], self.number[kept], None)


@dataclass(frozen=True)
class HeldSurvey:
    """A cloud in memory: ``xyz`` (n, 3) metres and ``values`` (n,), the error by plants of each point, if known."""

    xyz: Float
    values: NDArray[np.floating] | None = None

    def __len__(self) -> int:
        return len(self.xyz)

    @cached_property
    def bounds(self) -> tuple[Float, Float]:
        """Lowest and highest coordinates, (3,) each."""
        return least(self.xyz), greatest(self.xyz)

    @cached_property
    def frame(self) -> LatticeFrame:
        """Of the searches through it."""
        return LatticeFrame.of(self.xyz)

    def parts(self) -> Iterator[Float]:
        """The points (n, 3) in their order, in one."""
        yield self.xyz

    def within(self, box: Box) -> Near:
        """The points in a box, seen from above."""
        every = np.arange(len(self.xyz))
        if box == EVERYWHERE:
            return Near(self.xyz, every, self.values)
        kept = every[box.holds(self.xyz)]
        return Near(self.xyz[kept], kept, None if self.values is None else self.values[kept])


@dataclass(frozen=True)
class StoredSurvey:
    """A cloud on the disk, of which at most ``at_once`` points (of both clouds together) are in memory.

    Attributes:
        cloud: its points in their order.
        squares: the same, sorted.
    """

    cloud: SpooledCloud
    squares: PointSquares
    at_once: int

    @classmethod
    def of(cls, cloud: SpooledCloud, at_once: int) -> StoredSurvey:
        return cls(cloud, PointSquares.of(cloud), at_once)

    def __len__(self) -> int:
        return len(self.cloud)

    @property
    def bounds(self) -> tuple[Float, Float]:
        """Lowest and highest coordinates, (3,) each."""
        return self.cloud.bounds

    @cached_property
    def frame(self) -> LatticeFrame:
        """Of the searches through it."""
        return LatticeFrame.of(self.cloud)

    def parts(self) -> Iterator[Float]:
        """The points (n, 3) in their order."""
        for xyz, _ in self.cloud.parts():
            yield xyz

    def within(self, box: Box) -> Near:
        """The points in a box, seen from above."""
        found = self.squares.within(box)
        values = np.array(found["more"][:, 0]) if self.squares.values else None
        return Near(np.ascontiguousarray(found["xyz"]), found["number"].astype(np.int64), values)


Survey = HeldSurvey | StoredSurvey


def boxes(surveys: Sequence[Survey], root: Box, reach: float = 0.0, *, share: float = 1.0) -> Iterator[Box]:
    """``root`` in boxes around each of which, ``reach`` metres far, the surveys have not more points than may be held.

    Args:
        share: of the points that are kept of those that are read.

    Raises:
        InputError: even the smallest boxes have more.
    """
    stored = [survey for survey in surveys if isinstance(survey, StoredSurvey)]
    if not stored:
        yield EVERYWHERE
        return
    allowed, open_boxes = stored[0].at_once, [root]
    while open_boxes:
        box = open_boxes.pop()
        around = box.grown(reach)
        if share * sum(survey.squares.count(around) for survey in stored) <= allowed:
            yield box
            continue
        if max(box.east - box.west, box.north - box.south) < _SMALLEST_BOX_M:
            raise InputError(
                f"The memory allowed holds {allowed:,} points at a time, and more lie within {reach:.3g} m around a "
                "place; raise --memory-limit, give smaller scales, or thin the clouds."
            )
        open_boxes += box.halves()[::-1]


def whole(survey: Survey) -> Box:
    """The box around a survey."""
    low, high = survey.bounds
    return Box.around(np.stack([low, high]))


def pieces(survey: Survey) -> Iterator[tuple[Box, Near]]:
    """All points of a survey, box by box, each once."""
    for box in boxes([survey], whole(survey)):
        near = survey.within(box)
        if len(near.xyz):
            yield box, near


def by_chance(number: Index, share: float) -> Bool:
    """Which points of a cloud, by their ``number`` (n,), are among a share of them that chance takes."""
    # splitmix64 (Steele et al. 2014, doi:10.1145/2660193.2660195)
    with np.errstate(over="ignore"):
        z = (number.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return np.asarray(z >> np.uint64(1) < np.uint64(math.floor(share * 2.0**63)))
