"""Boulders, walls, cars and heaps that are put into a raw cloud: returns below their top go up to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Bool, Float
from .patches import MIN_GROUND_POINTS, TRIALS

NOISE_M = 0.02
"""Standard deviation of a return from an object's top."""
Numbers = NDArray[np.uint8]
_REPOSE = np.tan(np.radians(35.0))


@dataclass(frozen=True)
class Shape:
    """``length`` and ``width`` (m) on the ground, and ``height`` (m) of the top of a ``kind``."""

    kind: str
    length: float
    width: float
    height: float

    def top(self, along: Float, across: Float) -> Float:
        """(n,) m over the ground at places (n,) from the middle, m; 0 outside."""
        if self.kind == "boulder":
            # a sphere that lies in the ground up to its height
            radius, away = self.length / 2, np.hypot(along, across)
            cap = np.sqrt(np.maximum(radius**2 - away**2, 0.0)) + self.height - radius
            return np.where(away <= radius, np.maximum(cap, 0.0), 0.0)
        if self.kind == "heap":
            share = np.hypot(along / self.length, across / self.width) * 2
            return np.maximum(self.height * (1.0 - share), 0.0)
        inside = (np.abs(along) <= self.length / 2) & (np.abs(across) <= self.width / 2)
        if self.kind == "car":
            cabin = np.abs(along + 0.3) <= 0.3 * self.length
            return np.where(inside, np.where(cabin, self.height, 0.6 * self.height), 0.0)
        return np.where(inside, self.height, 0.0)


SHAPES = (
    Shape("wall", 8.0, 0.5, 1.2),
    Shape("car", 4.4, 1.8, 1.5),
    Shape("heap", 3.6, 3.0, 1.5 * _REPOSE),
    Shape("boulder", 2.4, 2.4, 1.4),
    Shape("boulder", 1.2, 1.2, 0.8),
    Shape("boulder", 1.2, 1.2, 0.6),
)


@dataclass(frozen=True)
class Thing:
    """A shape on the plane ``gradient`` (2,) through its middle (3,), m, turned by ``azimuth`` radians."""

    shape: Shape
    middle: tuple[float, float, float]
    gradient: tuple[float, float]
    azimuth: float
    appeared: bool

    @property
    def reach(self) -> float:
        return float(np.hypot(self.shape.length, self.shape.width) / 2)

    @property
    def volume(self) -> float:
        """m³ over the ground, by squares of 2 cm."""
        step, reach = 0.02, self.reach
        side = np.arange(-reach, reach, step) + step / 2
        along, across = np.meshgrid(side, side)
        return float(self.shape.top(along.ravel(), across.ravel()).sum() * step**2)

    def away(self, xyz: Float) -> Float:
        return np.asarray(np.hypot(xyz[:, 0] - self.middle[0], xyz[:, 1] - self.middle[1]))

    def over(self, xyz: Float) -> Float:
        """(n,) heights (m) of points (n, 3) over the plane."""
        offset = xyz[:, :2] - self.middle[:2]
        return np.asarray(xyz[:, 2] - self.middle[2] - offset @ np.array(self.gradient))

    def top(self, xyz: Float) -> Float:
        """(n,) heights (m) of the top over the plane at points (n, 3); 0 outside."""
        east, north = (xyz[:, :2] - self.middle[:2]).T
        sine, cosine = np.sin(self.azimuth), np.cos(self.azimuth)
        return self.shape.top(east * cosine + north * sine, north * cosine - east * sine)

    def put_into(self, xyz: Float, random: np.random.Generator) -> tuple[Float, Bool]:
        """Points (n, 3) with those below the top on it, because a pulse ends there, and which (n,) these are."""
        top, over = self.top(xyz), self.over(xyz)
        hit = (top > 0.0) & (over < top)
        moved = xyz.copy()
        moved[hit, 2] += (top - over)[hit] + random.normal(0.0, NOISE_M, int(hit.sum()))
        return moved, hit


def ended(hit: Bool, number: Numbers) -> Bool:
    """(n,) returns that are left if pulses end at their first return on an object, of which ``hit`` (n,) are on one.

    The returns of a pulse follow each other in a file.
    """
    left = np.ones(len(hit), dtype=bool)
    left[1:] = ~(hit[1:] & hit[:-1] & (number[1:] == number[:-1] + 1))
    return left


def placed_things(grounds: Sequence[Float], random: np.random.Generator, gap: float) -> list[Thing]:
    """Each of ``SHAPES`` once as new and once as removed, ``gap`` m apart, over ground points of all (n, 3).

    A shape for which ``TRIALS`` draws find no place is left out.
    """
    low = np.max([ground[:, :2].min(axis=0) for ground in grounds], axis=0)
    high = np.min([ground[:, :2].max(axis=0) for ground in grounds], axis=0)
    every = np.concatenate(grounds)
    found: list[Thing] = []
    for shape in SHAPES:
        for appeared in (True, False):
            for _ in range(TRIALS):
                reach = np.hypot(shape.length, shape.width) / 2
                place = random.uniform(low + reach, high - reach)
                thing = _on_ground(shape, place, float(random.uniform(0, np.pi)), every, appeared)
                if thing is None or any(np.hypot(*(place - t.middle[:2])) < t.reach + reach + gap for t in found):
                    continue
                if all(np.count_nonzero(thing.away(ground) <= 0.6 * reach) >= MIN_GROUND_POINTS for ground in grounds):
                    found.append(thing)
                    break
    return found


def _on_ground(shape: Shape, place: Float, azimuth: float, ground: Float, appeared: bool) -> Thing | None:
    offset = ground[:, :2] - place
    near = np.hypot(*offset.T) < max(shape.length / 2, 1.5)
    if near.sum() < 2 * MIN_GROUND_POINTS:
        return None
    design = np.column_stack([offset[near], np.ones(near.sum())])
    east, north, height = np.linalg.lstsq(design, ground[near, 2], rcond=None)[0]
    return Thing(
        shape, (float(place[0]), float(place[1]), float(height)), (float(east), float(north)), azimuth, appeared
    )
