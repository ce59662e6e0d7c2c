"""The scene's local frame and its place in the projected reference system."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..engine.core.arrays import Float


@dataclass(frozen=True)
class Frame:
    """u runs along the road, v uphill across it, z up; (east, north, up) is the local origin in the world.

    ``dip_azimuth`` is the direction in which the slope faces, degrees clockwise from north; v points against it.
    """

    east: float = 500_512.0
    north: float = 3_500_256.0
    up: float = 64.0
    dip_azimuth: float = 150.0

    @property
    def axes(self) -> Float:
        """(2, 2): rows are the u and the v axis in (east, north)."""
        azimuth = math.radians(self.dip_azimuth + 180.0)
        ve, vn = math.sin(azimuth), math.cos(azimuth)
        return np.array([[vn, -ve], [ve, vn]])

    def to_world(self, local: Float) -> Float:
        """(n, 3) local to (n, 3) projected coordinates."""
        world = np.empty_like(local)
        plane = local[:, :2] @ self.axes
        # Column by column: adding a pair to every row would take several times as long.
        for axis, (values, origin) in enumerate(((plane[:, 0], self.east), (plane[:, 1], self.north))):
            np.add(values, origin, out=world[:, axis])
        np.add(local[:, 2], self.up, out=world[:, 2])
        return world

    def to_local(self, world: Float) -> Float:
        """(n, 3) projected coordinates to (n, 3) local."""
        local = np.empty_like(world)
        local[:, :2] = (world[:, :2] - (self.east, self.north)) @ self.axes.T
        local[:, 2] = world[:, 2] - self.up
        return local

    def rotate_to_local(self, east: Float, north: Float) -> tuple[Float, Float]:
        """u and v of places given relative to the origin; arrays of any shape."""
        (ue, un), (ve, vn) = self.axes
        return east * ue + north * un, east * ve + north * vn
