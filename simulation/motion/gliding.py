"""Motions with a soft edge: ground that glides along its face, or turns in it, and fades out to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...engine.core.arrays import Bool, Float
from .plane import FacePlane

MAX_COMPRESSION = 0.8
"""Of the ground at a soft edge; at 1 it would fold over itself."""


class TooFarError(ValueError):
    """Ground would move too far for its soft edge; ``most`` is how far it may, m."""

    def __init__(self, reason: str, most: float) -> None:
        super().__init__(f"{reason}; move it by at most {most:.2f} m")
        self.most = most


Bounds = tuple[float, float, float, float]


def fading(distance: Float, edge: float) -> Float:
    """Share of the motion at ``distance`` (1: the outline): 0 outside, a half cosine within ``edge`` of it, else 1."""
    inward = np.clip((1.0 - distance) / edge, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(math.pi * inward)


@dataclass(frozen=True)
class Glide:
    """Ground within an ellipse that moves ``amount`` m along the plane of its face.

    ``half_across`` and ``half_along`` (the dip) are half-axes in the plane, m; ``direction`` is 0 down the dip and 90
    towards u. Within ``edge`` (share of the half-axes) the motion fades out: 1 is creep, which fades from the middle
    on; with less, a core moves as one.

    Raises:
        TooFarError: the ground would fold over itself at its edge.
    """

    plane: FacePlane
    half_across: float
    half_along: float
    amount: float
    edge: float = 1.0
    direction: float = 0.0

    def __post_init__(self) -> None:
        _refuse_folds(abs(self.amount) * self._steepest, abs(self.amount), "along its edge")

    @property
    def kind(self) -> str:
        return "creep" if self.edge == 1.0 else "translation"

    @property
    def _steepest(self) -> float:
        """Largest fading per metre in the direction of the motion, 1/m."""
        turn = math.radians(self.direction)
        closest = math.hypot(math.cos(turn) / self.half_along, math.sin(turn) / self.half_across)
        return math.pi / 2 / self.edge * closest

    @property
    def vector(self) -> Float:
        """(3,) motion of the middle in (u, v, z), m."""
        turn = math.radians(self.direction)
        return self.amount * (np.array([math.sin(turn), -math.cos(turn), 0.0]) @ self.plane.axes)

    @property
    def half_axes(self) -> tuple[float, float]:
        """Across and along the dip, in the plane, m."""
        return self.half_across, self.half_along

    @property
    def bounds(self) -> Bounds:
        plane, along = self.plane, self.half_along * self.plane.cosine
        return plane.u - self.half_across, plane.v - along, plane.u + self.half_across, plane.v + along

    def carry(self, u: Float, v: Float, z: Float) -> Float:
        """(3, n) motion of the ground at (u, v, z), each (n,), m."""
        across, along = self.plane.across_and_along(u, v)
        weight = fading(np.hypot(across / self.half_across, along / self.half_along), self.edge)
        return self.vector[:, None] * weight

    def holds(self, u: Float, v: Float, z: Float) -> Bool:
        """Which ground is part of what moves; all, as the motion fades out to 0."""
        return np.ones(len(u), dtype=bool)

    def uncovered(self, u: Float, v: Float, ground: Float) -> Float:
        """Height at (u, v) of what the body has left; with a soft edge it leaves no place."""
        return np.full(len(u), -np.inf)

    def scaled(self, factor: float) -> Glide:
        return replace(self, amount=self.amount * factor)


@dataclass(frozen=True)
class Turn:
    """Ground within ``radius`` m of the middle that turns in the plane of its face.

    ``amount`` is the way (m) at the end of the core, which turns as one; within ``edge`` (share of the radius) of the
    outline the turn fades out. Positive turns the lower part towards u.

    Raises:
        TooFarError: the ground would be sheared too much at its edge.
    """

    plane: FacePlane
    radius: float
    amount: float
    edge: float = 0.5

    kind = "rotation"

    def __post_init__(self) -> None:
        _refuse_folds(abs(self.angle) * math.pi / 2 / self.edge, abs(self.amount), "at its edge")

    @property
    def angle(self) -> float:
        """Of the core, rad."""
        return self.amount / (self.radius * (1.0 - self.edge))

    @property
    def half_axes(self) -> tuple[float, float]:
        """Across and along the dip, in the plane, m."""
        return self.radius, self.radius

    @property
    def bounds(self) -> Bounds:
        plane, along = self.plane, self.radius * self.plane.cosine
        return plane.u - self.radius, plane.v - along, plane.u + self.radius, plane.v + along

    def carry(self, u: Float, v: Float, z: Float) -> Float:
        """(3, n) motion of the ground at (u, v, z), each (n,), m."""
        plane = self.plane
        across, over = plane.across_and_along(u, v)
        turn = self.angle * fading(np.hypot(across, over) / self.radius, self.edge)
        along = (v - plane.v) * plane.cosine + (z - plane.z) * plane.sine
        cosine, sine = np.cos(turn) - 1.0, np.sin(turn)
        moved = np.stack([cosine * across - sine * along, sine * across + cosine * along])
        return plane.axes[:2].T @ moved

    def holds(self, u: Float, v: Float, z: Float) -> Bool:
        """Which ground is part of what moves; all, as the motion fades out to 0."""
        return np.ones(len(u), dtype=bool)

    def uncovered(self, u: Float, v: Float, ground: Float) -> Float:
        """Height at (u, v) of what the body has left; with a soft edge it leaves no place."""
        return np.full(len(u), -np.inf)

    def scaled(self, factor: float) -> Turn:
        return replace(self, amount=self.amount * factor)


def _refuse_folds(compression: float, amount: float, where: str) -> None:
    if compression > MAX_COMPRESSION:
        most = math.floor(amount * MAX_COMPRESSION / compression * 100) / 100
        raise TooFarError(f"the ground {where} would be compressed or sheared by {compression:.2f}", most)
