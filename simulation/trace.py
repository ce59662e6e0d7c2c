"""First intersection of rays with a height field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..engine.core.arrays import Float

Height = Callable[[Float, Float], Float]


@dataclass(frozen=True)
class Rays:
    """Origins and unit directions in the local frame, each (3, n); row 0 is u, row 1 is v, row 2 is z."""

    origin: Float
    direction: Float

    def __len__(self) -> int:
        return self.origin.shape[1]

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Rays:
        return Rays(self.origin[:, index], self.direction[:, index])

    def at(self, distance: Float) -> Float:
        """(3, n) places at ``distance`` along the rays."""
        place: Float = self.origin + self.direction * distance
        return place


@dataclass(frozen=True)
class Steepness:
    """Bounds of the surface's gradient: |dz/du| and the range of dz/dv."""

    along: float
    low: float
    high: float

    def closing_rate(self, direction: Float) -> Float:
        """The fastest at which a ray can approach such a surface, m of height per m of path; at least 0.05."""
        du, dv, dz = direction
        rate = -dz + self.along * np.abs(du) + np.maximum(self.low * dv, self.high * dv)
        return np.maximum(rate, 0.05)


def approach(height: Height, rays: Rays, start: Float, steepness: Steepness, clearance: float, reach: float) -> Float:
    """Distance (n,) at which each ray has come within ``clearance`` m above the surface, without passing through it.

    Sphere tracing: the height above the surface divided by the closing rate is a safe step. Rays that travel
    beyond ``reach`` m keep that distance.
    """
    distance = start.copy()
    rate = steepness.closing_rate(rays.direction)
    active = np.arange(len(rays))
    origin, direction, t = rays.origin, rays.direction, distance.copy()
    for _ in range(400):
        above = origin[2] + t * direction[2] - height(origin[0] + t * direction[0], origin[1] + t * direction[1])
        going = (above > clearance) & (t < reach)
        step = np.where(going, (above - 0.7 * clearance) / rate, 0.0)
        t = t + step
        if not going.all():
            distance[active] = t
            active = active[going]
            if not len(active):
                return distance
            origin, direction, t, rate = origin[:, going], direction[:, going], t[going], rate[going]
    distance[active] = t
    return distance


def first_hit(
    height: Height, rays: Rays, start: Float, steepness: Steepness, reach: float, step: float = 0.02
) -> Float:
    """Distance (n,) of each ray's first hit, inf where there is none within ``reach``.

    Advances by safe steps but by ``step`` m at least, so that vertical edges are found, until the ray is below the
    surface; the crossing is then enclosed by the Illinois variant of false position.
    """
    hit = np.full(len(rays), np.inf)
    rate = steepness.closing_rate(rays.direction)
    active = np.arange(len(rays))
    origin, direction = rays.origin, rays.direction
    t = start.copy()
    above = origin[2] + t * direction[2] - height(origin[0] + t * direction[0], origin[1] + t * direction[1])
    hit[above <= 0] = t[above <= 0]
    keep = above > 0
    brackets: list[tuple[NDArray[np.intp], Float, Float, Float, Float]] = []
    while True:
        if not keep.all():
            active, t, above, rate = active[keep], t[keep], above[keep], rate[keep]
            origin, direction = origin[:, keep], direction[:, keep]
        if not len(active):
            break
        following = t + np.maximum(above / rate, step)
        below = (
            origin[2]
            + following * direction[2]
            - height(origin[0] + following * direction[0], origin[1] + following * direction[1])
        )
        crossed = below <= 0
        if crossed.any():
            brackets.append((active[crossed], t[crossed], following[crossed], above[crossed], below[crossed]))
        keep = ~crossed & (following < reach)
        t, above = following, below
    if brackets:
        index, low, high, above_low, below_high = (np.concatenate(parts) for parts in zip(*brackets, strict=True))
        hit[index] = _enclose(height, rays.take(index), low, high, above_low, below_high)
    hit[hit > reach] = np.inf
    return hit


def _enclose(height: Height, rays: Rays, low: Float, high: Float, above: Float, below: Float) -> Float:
    """Root of the height above ground between ``low`` (above > 0) and ``high`` (below <= 0), false position."""
    side = np.zeros(len(low), dtype=np.int8)
    t = high
    for _ in range(6):
        t = low + (high - low) * above / (above - below)
        value = _above(height, rays, t)
        over = value > 0
        below = np.where(over & (side == 1), below / 2, below)
        above = np.where(~over & (side == -1), above / 2, above)
        low, above = np.where(over, t, low), np.where(over, value, above)
        high, below = np.where(over, high, t), np.where(over, below, value)
        side = np.where(over, 1, -1).astype(np.int8)
    # A vertical face has no root to converge to: halve until its place is known.
    index = np.flatnonzero((np.abs(value) > 1e-4) & (high - low > 1e-4))
    if len(index):
        faces, first, last = rays.take(index), low[index], high[index]
        for _ in range(10):
            middle = (first + last) / 2
            over = _above(height, faces, middle) > 0
            first, last = np.where(over, middle, first), np.where(over, last, middle)
        t[index] = last
    return t


def _above(height: Height, rays: Rays, t: Float) -> Float:
    """Height above the surface of the rays' places at distance ``t``, m."""
    place = rays.at(t)
    above: Float = place[2] - height(place[0], place[1])
    return above
