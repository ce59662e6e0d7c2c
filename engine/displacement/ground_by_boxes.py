"""Ground points found by boxes on the map, sorted by their eastings: in memory, or on the disk with the same bytes."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..core.arrays import Float
from ..core.errors import InputError
from ..pointcloud.point_squares import Box
from .stored_ground import Ground, StoredGround

Bounds = tuple[float, float, float, float]
"""West, south, east and north, metres."""
_EDGE_M = 0.01  # beyond what is asked for, so that no rounding leaves out a point


class GroundByBoxes(Protocol):
    """A survey's ground."""

    def within(self, bounds: Bounds) -> Float:
        """The points (n, 3) in a box, sorted by their eastings."""


class SortedCloud:
    """Points (n, 3) in memory."""

    def __init__(self, xyz: Float) -> None:
        self.xyz = xyz[np.argsort(xyz[:, 0], kind="stable")]

    def within(self, bounds: Bounds) -> Float:
        """See ``GroundByBoxes``."""
        west, south, east, north = bounds
        start, end = np.searchsorted(self.xyz[:, 0], (west, east))
        part = self.xyz[start:end]
        return np.asarray(part[(part[:, 1] >= south) & (part[:, 1] <= north)])


class StoredCloud:
    """Points on the disk, of which those of a box are read."""

    def __init__(self, ground: StoredGround) -> None:
        self.ground = ground

    def within(self, bounds: Bounds) -> Float:
        """See ``GroundByBoxes``.

        Raises:
            InputError: they are more than may be in memory at a time.
        """
        west, south, east, north = bounds
        box = Box(*bounds).grown(_EDGE_M)
        if self.ground.squares.count(box) > self.ground.at_once:
            raise InputError(
                f"The memory allowed holds {self.ground.at_once:,} points of a survey at a time, and more lie around "
                "one zone; raise --memory-limit, or give a region of interest around a part of the slope."
            )
        part = self.ground.within(box)
        x, y = part[:, 0], part[:, 1]
        part = part[(x >= west) & (x < east) & (y >= south) & (y <= north)]
        return part[np.argsort(part[:, 0], kind="stable")]


def by_boxes(ground: Ground) -> GroundByBoxes:
    """The points of a survey, found by boxes."""
    return StoredCloud(ground) if isinstance(ground, StoredGround) else SortedCloud(ground)
