"""A rotational slump: a body that turns as one on a slip surface, leaves a scarp at its head and heaves at its toe."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...engine.core.arrays import Bool, Float
from .gliding import Bounds
from .plane import FacePlane

_TOE_ROOM_M = 1.0
"""Beyond the plane's ellipse, as the ground's relief puts the edge further out."""


@dataclass(frozen=True)
class RotationalSlump:
    """Ground above a slip surface, ``depth`` m deep in the middle, that turns about an axis over the face.

    The slip surface is one of revolution about the level axis, so that the body slides on it without a gap; it meets
    the face's plane in an ellipse of ``half_across`` and ``half_along`` (the dip) m. ``amount`` is the way of the
    surface in the middle, m. Where the toe is pushed out over the ground it would leave a hollow beneath; the body
    settles by ``settlement`` m, so that the toe holds what the scarp has lost (see ``moved_ground.settled``).
    """

    plane: FacePlane
    half_across: float
    half_along: float
    depth: float
    amount: float
    settlement: float = 0.0

    kind = "slump"

    @property
    def lever(self) -> float:
        """Height of the axis over the plane, m: that of the circle through head, toe and the deepest point."""
        return (self.half_along**2 - self.depth**2) / (2 * self.depth)

    @property
    def axis(self) -> tuple[float, float]:
        """v and z of the axis, which runs along u."""
        return self.plane.v - self.lever * self.plane.sine, self.plane.z + self.lever * self.plane.cosine

    @property
    def angle(self) -> float:
        """By which the body has turned, rad."""
        return self.amount / self.lever

    @property
    def half_axes(self) -> tuple[float, float]:
        """Across and along the dip, in the plane, m."""
        return self.half_across, self.half_along

    @property
    def bounds(self) -> Bounds:
        plane = self.plane
        along = self.half_along * plane.cosine + _TOE_ROOM_M + abs(self.amount)
        return plane.u - self.half_across, plane.v - along, plane.u + self.half_across, plane.v + along

    def _radius(self, u: Float) -> Float:
        """Of the slip surface about the axis at u, m; 0 beyond the body's sides."""
        across = (u - self.plane.u) / self.half_across
        chord = self.half_along**2 * (1.0 - across**2)
        return np.where(chord > 0, np.sqrt(self.lever**2 + np.maximum(chord, 0.0)), 0.0)

    def carry(self, u: Float, v: Float, z: Float) -> Float:
        """(3, n) motion that ground at (u, v, z), each (n,), has as part of the body, m."""
        axis_v, axis_z = self.axis
        sine, cosine = math.sin(self.angle), math.cos(self.angle) - 1.0
        level, over = v - axis_v, z - axis_z
        return np.stack(
            [np.zeros_like(u), cosine * level + sine * over, cosine * over - sine * level - self.settlement]
        )

    def holds(self, u: Float, v: Float, z: Float) -> Bool:
        """Which ground lies above the slip surface."""
        axis_v, axis_z = self.axis
        room = self.half_along * self.plane.cosine + _TOE_ROOM_M
        inside: Bool = np.hypot(v - axis_v, z - axis_z) < self._radius(u)
        return inside & (np.abs(v - self.plane.v) < room)

    def uncovered(self, u: Float, v: Float, ground: Float) -> Float:
        """Height at (u, v) of what the body has left: the slip surface, or the ``ground`` that was never part of it."""
        axis_v, axis_z = self.axis
        slip = axis_z - np.sqrt(np.maximum(self._radius(u) ** 2 - (v - axis_v) ** 2, 0.0))
        return np.where(self.holds(u, v, ground), slip, ground)

    def scaled(self, factor: float) -> RotationalSlump:
        return replace(self, amount=self.amount * factor, settlement=0.0)
