"""Known changes of the ground between two epochs: exact functions of place, in the scene's local frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from ...engine.core.arrays import Float
from ...engine.grid.grid import Grid
from ..frame import Frame

Bounds = tuple[float, float, float, float]


class Change(Protocol):
    """A height change ``dz`` that is zero outside ``bounds`` (u and v from, u and v to)."""

    @property
    def kind(self) -> str: ...

    @property
    def bounds(self) -> Bounds: ...

    @property
    def volumes(self) -> tuple[float, float]:
        """Raised and lowered volume, both positive, m³."""
        ...

    def dz(self, u: Float, v: Float) -> Float: ...


@dataclass(frozen=True)
class Plateau:
    """A square raised by ``height`` with vertical edges, turned by ``rotation`` degrees from the u axis."""

    u: float
    v: float
    side: float = 1.0
    height: float = 0.16
    rotation: float = 0.0

    kind = "plateau"

    def dz(self, u: Float, v: Float) -> Float:
        turn = math.radians(self.rotation)
        du, dv = u - self.u, v - self.v
        along = np.abs(du * math.cos(turn) + dv * math.sin(turn))
        across = np.abs(dv * math.cos(turn) - du * math.sin(turn))
        return np.where(np.maximum(along, across) <= self.side / 2, self.height, 0.0)

    @property
    def bounds(self) -> Bounds:
        turn = math.radians(self.rotation)
        reach = self.side / 2 * (abs(math.cos(turn)) + abs(math.sin(turn)))
        return self.u - reach, self.v - reach, self.u + reach, self.v + reach

    @property
    def volumes(self) -> tuple[float, float]:
        volume = self.side**2 * self.height
        return max(volume, 0.0), max(-volume, 0.0)


@dataclass(frozen=True)
class Cone:
    """A circular cone of ``diameter`` at its foot and height ``peak``."""

    u: float
    v: float
    diameter: float = 1.06
    peak: float = 0.36

    kind = "cone"

    def dz(self, u: Float, v: Float) -> Float:
        distance = np.hypot(u - self.u, v - self.v)
        return self.peak * np.maximum(1.0 - distance / (self.diameter / 2), 0.0)

    @property
    def bounds(self) -> Bounds:
        reach = self.diameter / 2
        return self.u - reach, self.v - reach, self.u + reach, self.v + reach

    @property
    def volumes(self) -> tuple[float, float]:
        volume = math.pi * (self.diameter / 2) ** 2 * self.peak / 3
        return max(volume, 0.0), max(-volume, 0.0)


@dataclass(frozen=True)
class Bump:
    """A smooth elliptic bulge (``height`` > 0) or bowl (< 0): height (1 - r²)², r the distance in half-axes."""

    u: float
    v: float
    half_u: float
    half_v: float
    height: float

    @property
    def kind(self) -> str:
        return "bulge" if self.height >= 0 else "depression"

    def dz(self, u: Float, v: Float) -> Float:
        square = ((u - self.u) / self.half_u) ** 2 + ((v - self.v) / self.half_v) ** 2
        return self.height * np.maximum(1.0 - square, 0.0) ** 2

    @property
    def bounds(self) -> Bounds:
        return self.u - self.half_u, self.v - self.half_v, self.u + self.half_u, self.v + self.half_v

    @property
    def volumes(self) -> tuple[float, float]:
        # Integral of (1 - r²)² over the unit disc is pi / 3.
        volume = math.pi / 3 * self.half_u * self.half_v * self.height
        return max(volume, 0.0), max(-volume, 0.0)


@dataclass(frozen=True)
class Slump:
    """Depletion above, accumulation below: two smooth lobes that touch at (u, v), ``length`` m up and down slope.

    ``depth`` is the largest lowering; the lower lobe is as wide as ``spread`` times the upper one and holds
    ``bulking`` times its volume.
    """

    u: float
    v: float
    half_width: float
    length: float
    depth: float
    spread: float = 1.2
    bulking: float = 1.0

    kind = "slump"

    @property
    def lobes(self) -> tuple[Bump, Bump]:
        half = self.length / 4
        upper = Bump(self.u, self.v + half, self.half_width, half, -self.depth)
        raised = self.depth * self.bulking / self.spread
        lower = Bump(self.u, self.v - half, self.half_width * self.spread, half, raised)
        return upper, lower

    def dz(self, u: Float, v: Float) -> Float:
        upper, lower = self.lobes
        return upper.dz(u, v) + lower.dz(u, v)

    @property
    def bounds(self) -> Bounds:
        upper, lower = (lobe.bounds for lobe in self.lobes)
        return min(upper[0], lower[0]), lower[1], max(upper[2], lower[2]), upper[3]

    @property
    def volumes(self) -> tuple[float, float]:
        upper, lower = self.lobes
        return lower.volumes[0], upper.volumes[1]


def total_dz(changes: Sequence[Change], u: Float, v: Float) -> Float:
    """Sum of the changes at (u, v), m; only points within a change's bounds are evaluated."""
    total = np.zeros(np.broadcast(u, v).shape)
    for change in changes:
        west, south, east, north = change.bounds
        inside = (u >= west) & (u <= east) & (v >= south) & (v <= north)
        if inside.any():
            total[inside] += change.dz(u[inside], v[inside])
    return total


def true_change_raster(changes: Sequence[Change], frame: Frame, grid: Grid, subsamples: int = 32) -> Float:
    """Mean change of each cell of ``grid`` (rows, columns), m: what a perfect gridded survey would show.

    Each cell that a change may touch is sampled at ``subsamples`` x ``subsamples`` places; elsewhere it is 0.
    """
    raster = np.zeros(grid.shape)
    offsets = (np.arange(subsamples) + 0.5) / subsamples * grid.cell
    # Large changes are split in blocks of rows so that the sub-samples fit in memory.
    touched = np.zeros(grid.shape, dtype=bool)
    for change in changes:
        west, south, east, north = change.bounds
        corners = frame.to_world(np.array([[west, south, 0], [east, south, 0], [east, north, 0], [west, north, 0]]))
        low, high = corners.min(axis=0), corners.max(axis=0)
        columns = slice(
            max(0, math.floor((low[0] - grid.west) / grid.cell)),
            max(0, math.floor((high[0] - grid.west) / grid.cell) + 1),
        )
        rows = slice(
            max(0, math.floor((grid.north - high[1]) / grid.cell)),
            max(0, math.floor((grid.north - low[1]) / grid.cell) + 1),
        )
        touched[rows, columns] = True
    row, column = np.nonzero(touched)
    block = max(1, 2_000_000 // subsamples**2)
    for start in range(0, len(row), block):
        i, j = row[start : start + block], column[start : start + block]
        x = (grid.west - frame.east + j * grid.cell)[:, None, None] + offsets[None, None, :]
        y = (grid.north - frame.north - (i + 1) * grid.cell)[:, None, None] + offsets[None, :, None]
        u, v = frame.rotate_to_local(*np.broadcast_arrays(x, y))
        raster[i, j] = total_dz(changes, u, v).mean(axis=(1, 2))
    return raster


def describe(change: Change, frame: Frame) -> dict[str, Any]:
    """Kind, place, size and volumes of a change, for truth.json."""
    values: dict[str, Any] = asdict(change)  # type: ignore[call-overload]
    place = frame.to_world(np.array([[values["u"], values["v"], 0.0]]))[0]
    raised, lowered = change.volumes
    return {
        "kind": change.kind,
        "x": round(float(place[0]), 4),
        "y": round(float(place[1]), 4),
        "shape": values,
        "volume_raised_m3": raised,
        "volume_lowered_m3": lowered,
    }
