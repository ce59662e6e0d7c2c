"""The planes along which a slope is measured: one where it faces one way, more where its normals turn."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..core.errors import InputError
from ..geometry.columns import greatest, least
from ..geometry.plane_cells import Planes, planes_of
from ..geometry.plane_kernels import product_sums
from ..pointcloud.point_squares import Box
from .frame import Frame
from .stored_ground import Ground, StoredGround

MAX_TURN_DEG = 25.0
"""Normals that turn farther from a facet's own belong to another facet."""
_CELL_M = 2.5  # side of the cells whose normals are compared; with those around as wide as a window
_MIN_CELL_POINTS = 5
_MIN_SHARE, _MIN_AREA_M2 = 0.02, 100.0  # of a facet that is worth a plane of its own
_MAX_FACETS = 12
_ROUNDS = 10
_LEVEL_SINE = 0.02  # below, a plane has no direction of dip
_EDGE_M = 0.01  # around squares that are read from the disk, so that no rounding leaves out a point


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


def find_facets(ground: Ground) -> Facets:
    """The facets of a surface of points (n, 3).

    Raises:
        InputError: there are too few points for a plane anywhere.
    """
    corner, base, sums = _plane_sums(ground)
    counts = sums[0]
    height, east, north = planes_of(sums, Planes.AROUND, 0.0, 1e-4)
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


def _plane_sums(ground: Ground) -> tuple[Float, float, Float]:
    """Corner (2,) of the squares, median height, and the sums (9, columns, rows) of ``product_sums`` over each."""
    if isinstance(ground, StoredGround):
        return _sums_on_disk(ground)
    corner = _corner(least(ground[:, :2]))
    base = float(np.median(ground[:, 2]))
    return corner, base, _sums_of(ground, corner, base, np.zeros(2, dtype=np.int64), None)


def _corner(low: Float) -> Float:
    return np.floor(low / _CELL_M) * _CELL_M


def _sums_of(xyz: Float, corner: Float, base: float, begin: Index, shape: Index | None) -> Float:
    """Sums over the squares of a window of ``shape`` (2,) from square ``begin`` (2,) on; None: up to the last one."""
    place = (xyz[:, :2] - corner) / _CELL_M
    index = np.floor(place).astype(np.int64)
    if shape is None:
        shape = greatest(index) + 1
    else:
        inside = ((index >= begin) & (index < begin + shape)).all(axis=1)
        xyz, place, index = xyz[inside], place[inside], index[inside]
    x, y = np.ascontiguousarray((place - index - 0.5).T)
    key = (index[:, 0] - begin[0]) * shape[1] + index[:, 1] - begin[1]
    sums = product_sums(key, x, y, xyz[:, 2] - base, np.ones(len(xyz)), int(shape[0] * shape[1]))
    return sums.reshape(9, *shape)


def _sums_on_disk(ground: StoredGround) -> tuple[Float, float, Float]:
    """As in memory: a square's points are taken together and in their order, some squares at a time."""
    low, high = ground.cloud.bounds
    corner, base = _corner(low[:2]), ground.cloud.median_height()
    whole = np.floor((high[:2] - corner) / _CELL_M).astype(np.int64) + 1
    sums = np.zeros((9, *whole))
    waiting = [(np.zeros(2, dtype=np.int64), whole)]
    while waiting:
        begin, end = waiting.pop()
        west, south, east, north = (*(corner + begin * _CELL_M), *(corner + end * _CELL_M))
        box = Box(float(west), float(south), float(east), float(north)).grown(_EDGE_M)
        count = ground.squares.count(box)
        if count > ground.at_once and (end - begin).max() > 1:
            middle = end.copy()
            longer = int(np.argmax(end - begin))
            middle[longer] = (begin[longer] + end[longer]) // 2
            after = begin.copy()
            after[longer] = middle[longer]
            waiting += [(after, end), (begin, middle)]
        elif count:
            part = _sums_of(ground.within(box), corner, base, begin, end - begin)
            sums[:, begin[0] : end[0], begin[1] : end[1]] = part
    return corner, base, sums


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
