"""The height of ground that has moved along itself: every place shows the ground that has come there."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from ...engine.core.arrays import Bool, Float
from .gliding import Bounds
from .plane import FacePlane
from .slump import RotationalSlump

Height = Callable[[Float, Float], Float]
_CLOSE_M = 1e-7
_MAX_STEPS = 80
_COUNT_STEP_M = 0.04
_VISIBLE_M = 1e-4
"""Ground that lies deeper than this under what has come over it is not visible."""


class SurfaceMotion(Protocol):
    """Ground that moves along itself; nothing changes outside ``bounds`` (u and v from, u and v to)."""

    @property
    def kind(self) -> str: ...

    @property
    def plane(self) -> FacePlane: ...

    @property
    def amount(self) -> float: ...

    @property
    def half_axes(self) -> tuple[float, float]:
        """Across and along the dip, in the plane, m."""
        ...

    @property
    def bounds(self) -> Bounds: ...

    def carry(self, u: Float, v: Float, z: Float) -> Float: ...

    def holds(self, u: Float, v: Float, z: Float) -> Bool: ...

    def uncovered(self, u: Float, v: Float, ground: Float) -> Float: ...

    def scaled(self, factor: float) -> SurfaceMotion: ...


AnyMotion = TypeVar("AnyMotion", bound=SurfaceMotion)


@dataclass(frozen=True)
class Arrived:
    """What is seen at places (n,): its height, where the material came from (u, v), whether it has moved there.

    Where ``fresh``, it was inside the ground before.
    """

    z: Float
    u: Float
    v: Float
    moved: Bool
    fresh: Bool


def arrived(motion: SurfaceMotion, ground: Height, u: Float, v: Float) -> Arrived:
    """What is seen at (u, v), each (n,), once the ``ground`` has moved."""
    from_u, from_v = u.copy(), v.copy()
    under_way = np.arange(len(u))
    # A fixed point: the motion changes by less than the place does, see ``gliding.MAX_COMPRESSION``.
    for _ in range(_MAX_STEPS):
        du, dv, _ = motion.carry(from_u[under_way], from_v[under_way], ground(from_u[under_way], from_v[under_way]))
        next_u, next_v = u[under_way] - du, v[under_way] - dv
        going = (np.abs(next_u - from_u[under_way]) > _CLOSE_M) | (np.abs(next_v - from_v[under_way]) > _CLOSE_M)
        from_u[under_way], from_v[under_way] = next_u, next_v
        under_way = under_way[going]
        if not len(under_way):
            break
    z = ground(from_u, from_v)
    still = ground(u, v)
    left = motion.uncovered(u, v, still)
    top = z + motion.carry(from_u, from_v, z)[2]
    moved = motion.holds(from_u, from_v, z) & (top >= left)
    return Arrived(
        np.where(moved, top, left),
        np.where(moved, from_u, u),
        np.where(moved, from_v, v),
        moved,
        ~moved & (left < still),
    )


def within(motion: SurfaceMotion, u: Float, v: Float) -> Bool:
    """Which places the motion may have changed."""
    west, south, east, north = motion.bounds
    inside: Bool = (u > west) & (u < east) & (v > south) & (v < north)
    return inside


def moved_height(motion: SurfaceMotion, ground: Height, u: Float, v: Float) -> Float:
    """Height at (u, v), each (n,), once the ``ground`` has moved, m."""
    return arrived(motion, ground, u, v).z


def volumes(motion: SurfaceMotion, ground: Height, step: float = _COUNT_STEP_M) -> tuple[float, float]:
    """Raised and lowered volume, both positive, m³, summed at places ``step`` m apart."""
    west, south, east, north = motion.bounds
    columns, rows = math.ceil((east - west) / step), math.ceil((north - south) / step)
    across, along = (east - west) / columns, (north - south) / rows
    u: Float = (west + across * (np.arange(columns) + 0.5)).astype(np.float64, copy=False)
    raised = lowered = 0.0
    for row in range(rows):
        v: Float = np.full(columns, south + along * (row + 0.5), dtype=np.float64)
        change = moved_height(motion, ground, u, v) - ground(u, v)
        raised += float(change[change > 0].sum())
        lowered -= float(change[change < 0].sum())
    return raised * across * along, lowered * across * along


def settled(motion: AnyMotion, ground: Height) -> AnyMotion:
    """The motion with as much settlement as makes a slump's toe hold what its scarp has lost; others as they are."""
    if not isinstance(motion, RotationalSlump) or motion.amount == 0:
        return motion

    def surplus(settlement: float) -> float:
        raised, lowered = volumes(replace(motion, settlement=settlement), ground)
        return raised - lowered

    # Over the body the volume falls evenly with the settlement; two secants suffice.
    low, high = 0.0, surplus(0.0) / (math.pi * motion.half_across * motion.half_along * motion.plane.cosine)
    before = surplus(low)
    for _ in range(3):
        if high == low:
            break
        after = surplus(high)
        if after == before:
            break
        low, high, before = high, high - after * (high - low) / (after - before), after
    return replace(motion, settlement=high)


def true_motion(motion: SurfaceMotion, ground: Height, u: Float, v: Float) -> Float:
    """(n, 3) way in (u, v, z) of the ground at (u, v), each (n,), m; NaN where it is buried afterwards."""
    z = ground(u, v)
    way = np.where(motion.holds(u, v, z), motion.carry(u, v, z), 0.0)
    seen = moved_height(motion, ground, u + way[0], v + way[1])
    way[:, np.abs(seen - (z + way[2])) > _VISIBLE_M] = np.nan
    return np.ascontiguousarray(way.T)
