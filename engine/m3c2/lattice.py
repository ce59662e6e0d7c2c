"""Which points of a cloud can lie in a cylinder or a ball: candidates by cubes of the cloud's own frame.

The points are sorted by cubes, each cut into eight parts, once. A surface seen along its dominant plane's normal is
thin: all that a cylinder across it can hold lies in the cells that the cylinder covers in that plane, a few runs of
neighbouring cubes. Of these only cubes, and of these only parts, are looked into whose sphere around their points the
cylinder's axis comes near. What lies within is for the caller to test; nothing within is ever left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..pointcloud.in_parts import Points, every_of, parts_of
from .kernels import Searched

CUBES_PER_RADIUS = 1.0  # measured: smaller cubes fit the cylinder better, but take more looking up
_CHUNK_PAIRS = 500_000  # pairs of a place and a point held at a time; some 150 bytes each, fewer stay in a faster cache
_CHUNK_ROWS = 500_000  # rows of cells looked up at a time
_SAMPLE_POINTS = 100_000
_MAX_CUBES = 2.0**57  # the key of one takes three bits less


def dominant_frame(xyz: Float) -> Float:
    """Rows (3, 3): two axes in the plane that fits the points (n, 3) best, and its normal, which points upwards."""
    some = np.ascontiguousarray(xyz[:: max(1, len(xyz) // _SAMPLE_POINTS)])
    local = some - some.mean(axis=0)
    _, vectors = np.linalg.eigh(local.T @ local)
    u, w = vectors[:, 2], vectors[:, 0]
    w = w if w[2] >= 0 else -w
    return np.stack([u, np.cross(w, u), w])


@dataclass(frozen=True)
class _Spheres:
    """Spheres around ``m`` groups of points: ``centre`` (3, m), ``radius`` (m,). Group k holds the ``sizes[k]``
    members from ``bounds[k]`` on of what comes next: smaller groups, or points.
    """

    bounds: Index
    sizes: Index
    centre: Float
    radius: Float


@dataclass(frozen=True)
class LatticeFrame:
    """Where the cubes of a cloud lie: ``axes`` (3, 3), see ``dominant_frame``, through ``origin`` (3,), a point of it.

    ``low`` (3,) is the least of the points along the axes, ``wide`` (3,) how far they reach from there, and ``largest``
    the largest of their coordinates' amounts; metres.
    """

    axes: Float
    origin: Float
    low: Float
    wide: Float
    largest: float

    @classmethod
    def of(cls, points: Points) -> LatticeFrame:
        """That of a cloud, n > 0."""
        axes = dominant_frame(every_of(points, max(1, len(points) // _SAMPLE_POINTS)))
        origin: Float | None = None
        low, high, largest = np.full(3, np.inf), np.full(3, -np.inf), 0.0
        for xyz in parts_of(points):
            origin = xyz[0].copy() if origin is None else origin
            local = _turned(axes, xyz, origin)
            low, high = np.minimum(low, local.min(axis=1)), np.maximum(high, local.max(axis=1))
            largest = max(largest, float(np.abs(xyz).max()))
        assert origin is not None
        return cls(axes, origin, low, high - low, largest)

    def local(self, xyz: Float) -> Float:
        """Places (3, n) of points (n, 3) along the axes, from the least on."""
        return _turned(self.axes, xyz, self.origin) - self.low[:, None]


def _turned(axes: Float, xyz: Float, origin: Float) -> Float:
    # sums written out: those of a matrix product depend in their last digit on how many points there are
    x, y, z = (xyz[:, k] - origin[k] for k in range(3))
    return np.stack([a * x + b * y + c * z for a, b, c in axes])


class Lattice:
    """Points sorted by cubes along the axes of ``frame``.

    ``points`` (3, n), x, y and z by themselves, are in that order, and so are ``values`` (n,), a figure of each point,
    where there are any.
    """

    def __init__(
        self,
        xyz: Float,
        radius: float,
        values: NDArray[np.floating] | None = None,
        frame: LatticeFrame | None = None,
    ) -> None:
        """Sort ``xyz`` (n, 3) and the points' ``values`` (n,) for searches of about ``radius``.

        Args:
            frame: that of the cloud of which these points are a part; by default they are all.
        """
        known = frame or LatticeFrame.of(xyz)
        self.frame = known.axes
        self.cell = radius / CUBES_PER_RADIUS
        self._origin, self._low = known.origin, known.low
        self._digits = 16 * np.finfo(np.float64).eps * known.largest
        spans = np.floor(known.wide / self.cell) + 1
        if spans.prod() > _MAX_CUBES:
            # so few points in so many cubes: larger ones do as well
            self.cell *= float(spans.max()) / _MAX_CUBES ** (1 / 3)
            spans = np.floor(known.wide / self.cell) + 1
        self._columns, self._rows, layers = (int(s) for s in spans)
        local = known.local(xyz)
        local /= self.cell
        whole = np.floor(local)
        column, row, layer = whole.astype(np.int64)
        eighth = np.array([1, 2, 4]) @ (local - whole >= 0.5)
        key = ((row * self._columns + column) * layers + layer) * 8 + eighth
        order = np.argsort(key, kind="stable")
        key = key[order]
        self.points = np.stack([axis.take(order) for axis in xyz.T])
        self.values = None if values is None else values.take(order)
        if not len(key):
            return
        eighths, cubes = (np.append(runs(k)[1], len(key)) for k in (key, key // 8))
        self._key, self._layer = np.divmod(key[cubes[:-1]] // 8, layers)
        self._cubes = cubes
        self._levels = (self._spheres(cubes, np.searchsorted(eighths, cubes)), self._spheres(eighths, eighths))

    def _spheres(self, ends: Index, bounds: Index) -> _Spheres:
        """Around the points from each of ``ends`` (m + 1,) to the next."""
        sizes = np.diff(ends)
        centre = np.add.reduceat(self.points, ends[:-1], axis=1) / sizes
        apart = ((self.points - np.repeat(centre, sizes, axis=1)) ** 2).sum(axis=0)
        return _Spheres(bounds, np.diff(bounds), centre, np.sqrt(np.maximum.reduceat(apart, ends[:-1])))

    def candidates(self, places: Float, half_axes: Float, radius: float) -> Iterator[tuple[Index, Index]]:
        """Pairs (number of a place, number of a point) that hold every point within ``radius`` of a place's segment.

        Points are numbered as in ``points``. A segment runs from ``place - half_axis`` to ``place + half_axis``; a ball
        is one of no length.
        All pairs of a place are in one yield, one after the other; places without any pair are left out.

        Args:
            places: (m, 3).
            half_axes: (m, 3).
        """
        if not self.points.shape[1]:
            return
        place, axis = self._in_plane(places), half_axes @ self.frame[:2].T
        reach = self.reach(half_axes, radius)
        low = (place[:, 1] - np.abs(axis[:, 1]) - reach - self._low[1]) / self.cell
        high = (place[:, 1] + np.abs(axis[:, 1]) + reach - self._low[1]) / self.cell
        first = np.clip(np.floor(low), 0, self._rows).astype(np.int64)
        last = np.clip(np.floor(high), -1, self._rows - 1).astype(np.int64)
        rows = np.maximum(last - first + 1, 0)
        # neighbours in the plane one after the other, for the sake of the processor's cache
        column = np.clip(np.floor((place[:, 0] - self._low[0]) / self.cell), 0, self._columns - 1).astype(np.int64)
        order = np.lexsort((column, (first + last) // 2))
        squared = (half_axes**2).sum(axis=1)
        inverse = np.divide(1.0, squared, out=np.zeros_like(squared), where=squared > np.finfo(np.float64).tiny)
        segments = np.vstack([places.T, half_axes.T, inverse])
        for part in _parts(rows[order], _CHUNK_ROWS):
            chosen = order[part]
            chosen = chosen[rows[chosen] > 0]
            number = np.repeat(chosen, rows[chosen])
            row = _ranges(first[chosen], rows[chosen])
            start, stop = self._runs(row, place[number], axis[number], reach)
            points = self._cubes[stop] - self._cubes[start]
            held = np.bincount(np.repeat(np.arange(len(chosen)), rows[chosen]), points, len(chosen))
            ends = np.cumsum(rows[chosen])
            for few in _parts(held.astype(np.int64), _CHUNK_PAIRS):
                lines = slice(ends[few.start] - rows[chosen[few.start]], ends[few.stop - 1])
                size = stop[lines] - start[lines]
                owner, member = np.repeat(number[lines], size), _ranges(start[lines], size)
                for spheres in self._levels:
                    near = _near(spheres, member, segments, owner, reach)
                    group = member.take(near)
                    size = spheres.sizes.take(group)
                    owner, member = np.repeat(owner.take(near), size), _ranges(spheres.bounds.take(group), size)
                if len(member):
                    yield owner, member

    def searched(self) -> Searched | None:
        """What compiled loops look for points in; None without points."""
        if not self.points.shape[1]:
            return None
        cubes, parts = self._levels
        rows, column = np.divmod(self._key, self._columns)
        return Searched(
            points=self.points,
            column=column,
            layer=self._layer,
            row_cubes=np.searchsorted(rows, np.arange(self._rows + 1)),
            cubes=np.column_stack([cubes.centre.T, cubes.radius]),
            cube_members=np.append(cubes.bounds, cubes.bounds[-1] + cubes.sizes[-1]),
            parts=np.column_stack([parts.centre.T, parts.radius]),
            part_members=np.append(parts.bounds, parts.bounds[-1] + parts.sizes[-1]),
            axes=self.frame,
            origin=self._origin,
            low=self._low,
            cell=float(self.cell),
            shape=np.array([self._columns, self._rows]),
        )

    def reach(self, half_axes: Float, radius: float) -> float:
        """How far (m) from a segment points of ``candidates`` may lie, with what rounding may add to the radius."""
        length = float(np.abs(half_axes).max(initial=0.0))
        return radius + 1e-9 * (radius + length) + self._digits

    def along_rows(self, places: Float) -> Index:
        """Numbers (m,) of places (m, 3), neighbours one after the other, for the sake of the processor's cache."""
        column, row = np.floor((self._in_plane(places) - self._low[:2]).T / self.cell)
        return np.lexsort((column, row))

    def offsets(self, places: Float, number: Index, point: Index) -> tuple[Float, Float, Float]:
        """x, y and z of the points from their places (3, m), for pairs as ``candidates`` gives them.

        The difference of two coordinates is taken before anything else, so that large ones cost no digits.
        """
        x, y, z = (self.points[axis].take(point) - places[axis].take(number) for axis in range(3))
        return x, y, z

    def _in_plane(self, xyz: Float) -> Float:
        return (xyz - self._origin) @ self.frame[:2].T

    def _runs(self, row: Index, place: Float, axis: Float, reach: float) -> tuple[Index, Index]:
        """First and one past the last of the sorted points in each row of cells that a place's segment reaches."""
        below = row * self.cell + self._low[1] - place[:, 1]
        above = below + self.cell
        rise = np.abs(axis[:, 1])
        # the part of the segment, from -1 to 1 of its half length, that is near enough to the row
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(below - reach) / axis[:, 1], (above + reach) / axis[:, 1]])
        ends = np.where(axis[:, 1] == 0, [[-1.0], [1.0]], np.clip(np.sort(ends, axis=0), -1.0, 1.0))
        gap = np.maximum(0.0, np.maximum(below - rise, -rise - above))
        width = np.sqrt(np.maximum(reach**2 - gap**2, 0.0))
        reached = place[:, 0] + ends * axis[:, 0]
        left = np.floor((reached.min(axis=0) - width - self._low[0]) / self.cell - 1e-9)
        right = np.floor((reached.max(axis=0) + width - self._low[0]) / self.cell + 1e-9)
        left = np.clip(left, 0, self._columns).astype(np.int64)
        right = np.clip(right, -1, self._columns - 1).astype(np.int64)
        start = np.searchsorted(self._key, row * self._columns + left, side="left")
        stop = np.searchsorted(self._key, row * self._columns + right, side="right")
        return start, np.maximum(start, stop)


def _near(spheres: _Spheres, sphere: Index, segments: Float, number: Index, reach: float) -> Index:
    """Which of the pairs of a sphere and a segment are within ``reach``.

    ``segments`` (7, m): middle, half axis, and one over the half axis' squared length (0 where that is 0).
    """
    x, y, z = (spheres.centre[axis].take(sphere) - segments[axis].take(number) for axis in range(3))
    a, b, c, inverse = (row.take(number) for row in segments[3:])
    t = np.clip((x * a + y * b + z * c) * inverse, -1.0, 1.0)
    x -= a * t
    y -= b * t
    z -= c * t
    squared = x * x + y * y + z * z
    return np.flatnonzero(squared <= ((spheres.radius + reach) ** 2).take(sphere))


def runs(number: Index) -> tuple[Index, Index, Index]:
    """Runs of equal ``number`` (n,), n > 0: the numbers, where they start, and their lengths."""
    starts = np.flatnonzero(np.concatenate([[True], number[1:] != number[:-1]]))
    return number[starts], starts, np.diff(np.append(starts, len(number)))


def _ranges(starts: Index, sizes: Index) -> Index:
    """start, start + 1, ... start + size - 1 for each start and its size, one after the other."""
    ends = np.cumsum(sizes)
    return np.arange(ends[-1] if len(ends) else 0) + np.repeat(starts - (ends - sizes), sizes)


def _parts(sizes: Index, limit: int) -> Iterator[slice]:
    """Consecutive slices whose sizes sum to at most ``limit``, or that have one member."""
    ends = np.cumsum(sizes)
    start = 0
    while start < len(sizes):
        before = int(ends[start - 1]) if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, before + limit, side="right")))
        yield slice(start, stop)
        start = stop
