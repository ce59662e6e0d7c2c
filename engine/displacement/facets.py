"""The planes along which a slope is measured: one where it faces one way, more where its normals turn."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..core.errors import InputError
from ..geometry.columns import least
from ..geometry.plane_cells import Planes

MAX_TURN_DEG = 25.0
"""Normals that turn farther from a facet's own belong to another facet."""
_CELL_M = 2.5  # side of the cells whose normals are compared; with those around as wide as a window
_MIN_CELL_POINTS = 5
_MIN_SHARE, _MIN_AREA_M2 = 0.02, 100.0  # of a facet that is worth a plane of its own
_MAX_FACETS = 12
_ROUNDS = 10
_LEVEL_SINE = 0.02  # below, a plane has no direction of dip


@dataclass(frozen=True)
class Frame:
    """A plane's axes: along the dip downwards, across it to the left when one looks down, and normal to it.

    ``axes`` (3, 3) holds them row by row in the map's coordinates, ``origin`` (3,) is a point near the plane, metres.
    On level ground the first axis is east.
    """

    axes: Float
    origin: Float

    def to_plane(self, xyz: Float) -> Float:
        """(n, 3) along the dip, across and above the plane, metres."""
        return np.asarray((xyz - self.origin) @ self.axes.T)

    def to_map(self, vectors: Float) -> Float:
        """(n, 3) vectors of this frame as east, north and up."""
        return np.asarray(vectors @ self.axes)

    def rotated(self, covariance: Float) -> Float:
        """(n, 3, 3) covariances in this frame as those of east, north and up."""
        return np.asarray(self.axes.T @ covariance @ self.axes)


@dataclass(frozen=True)
class Facets:
    """The facets of a surface and where on the map each lies.

    ``number`` (columns, rows) is the facet of each square of ``side`` metres from ``corner`` (2,), -1 where there is
    no ground; ``height`` (columns, rows) is that of its middle, ``east`` and ``north`` its rise by metre.
    """

    frames: tuple[Frame, ...]
    number: NDArray[np.int64]
    corner: Float
    height: Float
    east: Float
    north: Float
    side: float = _CELL_M

    def squares(self, xy: Float) -> tuple[Index, Index]:
        """Column and row of the square of each place (n, 2), of the nearest one where it lies outside."""
        index = np.floor((xy - self.corner) / self.side).astype(np.int64)
        return tuple(np.clip(index[:, k], 0, self.number.shape[k] - 1) for k in (0, 1))  # type: ignore[return-value]

    def places(self, xy: Float) -> tuple[Index, Float]:
        """Facet of each place (n, 2), -1 for none, and the places (n, 3) on the surface."""
        squares = self.squares(xy)
        off = xy - (self.corner + (np.column_stack(squares) + 0.5) * self.side)
        z = self.height[squares] + self.east[squares] * off[:, 0] + self.north[squares] * off[:, 1]
        return self.number[squares], np.column_stack([xy, z])

    @cached_property
    def areas(self) -> Index:
        """Squares of each facet."""
        return np.bincount(self.number[self.number >= 0], minlength=len(self.frames))


def find_facets(xyz: Float) -> Facets:
    """The facets of a surface of points (n, 3).

    Raises:
        InputError: there are too few points for a plane anywhere.
    """
    corner = np.floor(least(xyz[:, :2]) / _CELL_M) * _CELL_M
    planes = Planes((xyz[:, :2] - corner) / _CELL_M)
    base = float(np.median(xyz[:, 2]))
    counts = planes.sum(np.ones(len(xyz)))
    height, east, north = planes.fit(xyz[:, 2] - base, np.ones(len(xyz)), 0.0, 1e-4)
    known = (counts >= _MIN_CELL_POINTS) & np.isfinite(height)
    if not known.any():
        raise InputError(
            f"The surveys have nowhere {_MIN_CELL_POINTS} ground points on {_CELL_M:g} x {_CELL_M:g} m, too few to "
            "see motion along the surface; give denser clouds."
        )
    east, north = east / _CELL_M, north / _CELL_M
    normal = np.stack([-east, -north, np.ones_like(east)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    directions, number = _directions(normal, known)
    middle = (
        np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in known.shape), indexing="ij"), axis=-1) * _CELL_M + corner
    )
    frames = []
    for k, direction in enumerate(directions):
        mine = number == k
        origin = np.append(middle[mine].mean(axis=0), base + height[mine].mean())
        frames.append(Frame(_axes(direction), np.asarray(origin)))
    return Facets(tuple(frames), number, corner, height + base, east, north)


def _directions(normal: Float, known: NDArray[np.bool_]) -> tuple[list[Float], NDArray[np.int64]]:
    """Directions of the facets, and the facet of each square by the direction nearest to its normal."""
    cosine = np.cos(np.radians(MAX_TURN_DEG))
    left = known.copy()
    least_squares = max(_MIN_SHARE * np.count_nonzero(known), _MIN_AREA_M2 / _CELL_M**2)
    directions: list[Float] = []
    while len(directions) < _MAX_FACETS and left.any():
        mean = _unit(normal[left].mean(axis=0))
        for _ in range(_ROUNDS):
            near = left & (normal @ mean > cosine)
            if not near.any():  # what is left faces all ways: begin with the middle of its largest group
                mean = normal[left][np.argmax((normal[left] @ normal[left][::7].T > cosine).sum(axis=1))]
                continue
            mean = _unit(normal[near].mean(axis=0))
        near = left & (normal @ mean > cosine)
        if directions and np.count_nonzero(near) < least_squares:
            break
        directions.append(mean)
        left &= ~near
    nearest = np.argmax(np.stack([normal @ d for d in directions]), axis=0)
    return directions, np.where(known, nearest, -1)


def _unit(vector: Float) -> Float:
    return np.asarray(vector / np.linalg.norm(vector))


def _axes(normal: Float) -> Float:
    level = np.array([normal[0], normal[1], 0.0])
    if np.linalg.norm(level) < _LEVEL_SINE:
        level = np.array([1.0, 0.0, 0.0])
    dip = _unit(level - (level @ normal) * normal)
    return np.stack([dip, np.cross(normal, dip), normal])
