"""Progressive densification of a triangulated surface: the ground as the lowest sheet that returns support.

Axelsson 2000 (DEM generation from laser scanner data using adaptive TIN models, IAPRS 33 B4): a few sure points span
triangles; a point joins where it lies close to its triangle and is seen from the triangle's corners under a small
angle; the triangles become smaller and the surface follows the ground. Here the points come from low to high in ever
smaller windows, so that a plant never joins before the ground next to it, and nothing joins because it is dense.

Works in a frame in which the slope lies flat.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, cKDTree

from ..core.arrays import Bool, Float, Index
from ..core.blas_threads import one_blas_thread
from ..geometry.columns import greatest, least, spans
from ..geometry.numbered import distinct, lowest_heights
from ..geometry.plane_gradient import gradient_parts
from .squares import first_of_runs, square_numbers

CANDIDATE_CELL_M = 0.5
"""One candidate each cell: its lowest point that has support."""
SUPPORT_DEPTH_M, SUPPORT_SHARE = 0.1, 0.012
"""A lowest point is believed if this share of its cell's points lies less than this above it."""
SEED_WINDOW_M, MIN_SEED_WINDOWS = 15.0, 5
"""Side of the windows whose lowest candidates are the seeds; a smaller cloud has this many across."""
MAX_SEED_SLOPE_DEG = 30.0
"""A seed that stands over all but one of its neighbours more steeply is in a crown."""
MAX_PIT_SLOPE_DEG, MAX_PIT_DEPTH_M = 50.0, 0.15
"""A candidate that lies deeper below all of its neighbours, and more steeply, is no ground."""
FIRST_SHARE, SHARE_STEP = 0.3, 0.1
"""Share of a point's largest angle under which it may be seen from its triangle: at first, and more each round."""
SPACING_M, SPACING_NEIGHBOURS = 0.6, 20
"""Spacing of candidates up to which they join under the same angle, and the neighbours by which it is measured."""
BEND, MAX_ANGLE_DEG = 0.3, 35.0
"""Inclination that ground gains for each metre of spacing, 10 degrees at SPACING_M, and the largest angle."""
CLOSE_M, MAX_DISTANCE_M = 0.05, 1.0
"""Distance from the triangle that joins at any angle, and the largest, or the spacing where that is larger."""
MIN_WINDOW_M = 1.0
MAX_ROUNDS = 24
MIN_GAIN_SHARE = 0.002
"""Share of new points in a round below which the surface is done."""
NEIGHBOURS, REACH_M = 6, 1.25
"""Ground points through which a plane is laid that continues the ground beyond an edge, and how far it reaches."""
OWN_NEIGHBOURS = 8
"""Candidates through which a plane is laid that leads back to the ground."""
SMOOTH_M, CONTINUED_M, CONTINUED_SHARE = 0.02, 0.06, 0.05
"""Largest scatter about such a plane; distance from it, at first and for each metre, within which a candidate joins."""
CONTINUED_ROUNDS = 8
_EDGE_M, _EDGE_POINTS = 5.0, 20


def lowest_of_cells(xyz: Float, cell: float, origin: Float | None = None) -> Index:
    """Index of the lowest point (n, 3) of each square cell of side ``cell`` that has points; see ``square_numbers``."""
    if not len(xyz):
        return np.zeros(0, dtype=np.int64)
    return _lowest(xyz, square_numbers(xyz, cell, origin))


def lowest_supported(xyz: Float, cell: float = CANDIDATE_CELL_M, origin: Float | None = None) -> Index:
    """Index of each cell's lowest point that SUPPORT_SHARE of the cell's points follow within SUPPORT_DEPTH_M.

    Single returns below the ground (multipath) have nothing right above them; where returns are few, every point has
    support.
    """
    if not len(xyz):
        return np.zeros(0, dtype=np.int64)
    key = square_numbers(xyz, cell, origin)
    _, number, counts = distinct(key)
    z = xyz[:, 2] - xyz[:, 2].min()
    place = number * (float(z.max()) + 1.0 + SUPPORT_DEPTH_M) + z
    least = np.maximum(1.0, SUPPORT_SHARE * counts)
    lowest = lowest_heights(number, place, len(counts))
    own = lowest[number]
    supported = place == own
    near, tied = (np.bincount(number[some], None, len(counts)) for some in (place <= own + SUPPORT_DEPTH_M, supported))
    # only where the lowest point is not believed the others are looked at, from below
    doubted = np.flatnonzero((near - tied + 1 < least)[number])
    if len(doubted):
        order = doubted[np.argsort(place[doubted], kind="stable")]
        above = np.searchsorted(place[order], place[order] + SUPPORT_DEPTH_M, side="right") - np.arange(len(order))
        supported[order] = above >= least[number[order]]
    chosen = np.flatnonzero(supported)
    return np.asarray(chosen[_lowest(xyz[chosen], key[chosen])], dtype=np.int64)


def seed_window_of(extent: float) -> float:
    """Side (m) of the windows from which seeds are taken, of a cloud whose shorter side is ``extent`` m long."""
    return min(SEED_WINDOW_M, max(MIN_WINDOW_M, extent / MIN_SEED_WINDOWS))


def densified(
    points: Float, anchored: Bool | None = None, window: float | None = None, sure: Bool | None = None
) -> Bool:
    """Which of the candidates (n, 3), at most one a cell, lie on the ground.

    Args:
        points: (n, 3) metres, in a frame in which the slope lies flat.
        anchored: (n,) candidates that the cloth found, from which the seeds are taken; all by default.
        window: side (m) of the windows from which seeds are taken, where the points are a part of a cloud.
        sure: (n,) candidates that are ground from the start.

    Returns:
        (n,) bool.
    """
    ground = np.zeros(len(points), dtype=bool)
    if len(points) == 0:
        return ground
    usable = ~_pits(points)
    window = seed_window_of(float(spans(points[:, :2]).min())) if window is None else window
    ground[_all_seeds(points, usable, anchored, window)] = True
    if sure is not None:
        ground |= usable & sure
    limits = _limits(points)
    _densify(points, ground, usable, limits, window)
    for _ in range(CONTINUED_ROUNDS):
        adjacent = _continued(points, ground, usable)
        if np.count_nonzero(adjacent) <= MIN_GAIN_SHARE * np.count_nonzero(ground):
            break
        ground |= adjacent
    _densify(points, ground, usable, limits, MIN_WINDOW_M, 1.0)
    return ground


@dataclass(frozen=True)
class _Limits:
    """Of each candidate (n,): the largest inclination (tangent of the angle) and distance (m)."""

    inclination: Float
    farthest: Float

    def join(self, index: Index, distance: Float, near: Float, share: float) -> Bool:
        """(m,) which of the candidates at ``index`` join, under a ``share`` of their inclination."""
        allowed = np.maximum(CLOSE_M, share * self.inclination[index] * near)
        return np.asarray(np.abs(distance) < np.minimum(allowed, self.farthest[index]), dtype=np.bool_)


def _limits(points: Float) -> _Limits:
    """Ground bends more between points that lie farther apart."""
    count = min(SPACING_NEIGHBOURS + 1, len(points))
    away = cKDTree(points[:, :2]).query(points[:, :2], k=[count])[0][:, 0]
    spacing = np.maximum(away * math.sqrt(math.pi / count), SPACING_M)
    inclination = np.minimum(BEND * spacing, math.tan(math.radians(MAX_ANGLE_DEG)))
    return _Limits(inclination, np.maximum(MAX_DISTANCE_M, spacing))


def _densify(
    points: Float, ground: Bool, usable: Bool, limits: _Limits, window: float, share: float = FIRST_SHARE
) -> None:
    """Let candidates join ``ground`` (n,), in place, until no more come."""
    for _ in range(MAX_ROUNDS):
        rest = np.flatnonzero(usable & ~ground)
        if not len(rest) or not ground.any():
            break
        distance, near = Triangles(points[ground]).seen(points[rest])
        joins = limits.join(rest, distance, near, share)
        last = share >= 1.0
        share = min(share + SHARE_STEP, 1.0)
        window = max(MIN_WINDOW_M, window / 2.0)
        if not joins.any():
            if last:
                break
            continue
        low = np.column_stack([points[rest[joins], :2], distance[joins]])
        chosen = rest[joins][lowest_of_cells(low, window)]
        ground[chosen] = True
        if last and len(chosen) < MIN_GAIN_SHARE * np.count_nonzero(ground):
            break


def _continued(points: Float, ground: Bool, usable: Bool) -> Bool:
    """(n,) candidates next to the ground that lie on a plane which continues it, or whose own plane leads to it.

    Beyond an edge, as of a berm, triangles span from below it to what lies behind, and what is on them is hidden. Where
    the ground bends upwards, as from a slope laid flat to the road below it, the first points beyond the bend are seen
    steeply.
    """
    joins = np.zeros(len(points), dtype=bool)
    base, rest = np.flatnonzero(ground), np.flatnonzero(usable & ~ground)
    if len(base) < NEIGHBOURS or not len(rest):
        return joins
    adjacent = cKDTree(points[base, :2]).query(points[rest, :2], k=3, distance_upper_bound=REACH_M)
    forward = _planes(points, base, points[base])
    back = _planes(points, rest, points[usable | ground], OWN_NEIGHBOURS)
    for away, nearest in zip(adjacent[0].T, adjacent[1].T, strict=True):
        found = np.flatnonzero(np.isfinite(away))
        vertex = nearest[found]
        limit = CONTINUED_M + CONTINUED_SHARE * away[found]
        over = np.abs(forward.over(vertex, points[rest[found]]))
        joins[rest[found[forward.sound[vertex] & (over < limit)]]] = True
        over = np.abs(back.over(found, points[base[vertex]]))
        joins[rest[found[back.sound[found] & (over < limit)]]] = True
    return joins


@dataclass(frozen=True)
class _LocalPlanes:
    """Planes through the points around each of some points: middles (n, 3), inclinations (n,), which are smooth."""

    middle: Float
    east: Float
    north: Float
    sound: Bool

    def over(self, which: Index, points: Float) -> Float:
        """(m,) height of points (m, 3) over the planes ``which`` (m,)."""
        offset = points - self.middle[which]
        return np.asarray(offset[:, 2] - self.east[which] * offset[:, 0] - self.north[which] * offset[:, 1])


def _planes(points: Float, index: Index, others: Float, count: int = NEIGHBOURS) -> _LocalPlanes:
    """Planes through the nearest ``count`` of ``others`` (m, 3) to each of the points at ``index``."""
    count = min(count, len(others))
    distance, neighbour = cKDTree(others[:, :2]).query(points[index, :2], k=count)
    around = others[neighbour]
    middle = around.mean(axis=1)
    local = around - middle[:, None]
    x, y, z = local[..., 0], local[..., 1], local[..., 2]
    xx, xy, yy, xz, yz = ((a * b).sum(axis=1) for a, b in ((x, x), (x, y), (y, y), (x, z), (y, z)))
    east, north, determinant = gradient_parts(xx, yy, xy, xz, yz)
    with np.errstate(invalid="ignore", divide="ignore"):
        east, north = east / determinant, north / determinant
    scatter = np.sqrt(((z - east[:, None] * x - north[:, None] * y) ** 2).sum(axis=1) / (count - 3))
    # a plane needs neighbours on several sides, not a row of them
    sound = (determinant > 0.05 * (xx + yy) ** 2) & (scatter < SMOOTH_M) & (distance[:, -1] < 2.0 * REACH_M)
    return _LocalPlanes(middle, east, north, sound)


class Triangles:
    """A surface of triangles through points (n, 3), level outwards from its edge."""

    def __init__(self, points: Float) -> None:
        rim = _rim(points)
        nearest = cKDTree(points[:, :2]).query(rim)[1]
        self.points = np.vstack([points, np.column_stack([rim, points[nearest, 2]])])
        self.middle = self.points[:, :2].mean(axis=0)
        self.mesh = Delaunay(self.points[:, :2] - self.middle)
        # scipy solves a tiny system for each triangle; the threads of a BLAS only wait for each other there
        with one_blas_thread():
            self.mesh.transform  # noqa: B018  (kept by the mesh once it was asked for)

    def height(self, xy: Float) -> Float:
        """Height of the surface at places (m, 2); NaN beyond it, more than 5 m outside the points' extent."""
        interpolator = LinearNDInterpolator(self.mesh, self.points[:, 2])
        return np.asarray(interpolator(xy - self.middle), dtype=np.float64)

    def seen(self, points: Float) -> tuple[Float, Float]:
        """Signed distance (m,) of points from their triangle's plane, and horizontal distance of its nearest corner.

        Beyond the surface the distance is infinite: points there are not judged.
        """
        triangle = self.mesh.find_simplex(points[:, :2] - self.middle)
        corners = self.points[self.mesh.simplices[triangle]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
        upward = np.where(normal[:, 2] < 0, -1.0, 1.0)
        distance = ((points - corners[:, 0]) * normal).sum(axis=1) / length * upward
        distance[triangle < 0] = np.inf
        near = np.hypot(*np.moveaxis(corners[:, :, :2] - points[:, None, :2], 2, 0)).min(axis=1)
        return distance, near


def _all_seeds(points: Float, usable: Bool, anchored: Bool | None, window: float) -> Index:
    """The lowest candidates of windows that the cloth found, and those of all that lie below them.

    Over closed plants the cloth hangs above the ground, so what lies lower is believed; what lies far above it, as on a
    roof, is not.
    """
    if anchored is None or not (usable & anchored).any():
        return _seeds(points, usable, window)
    found = _seeds(points, usable & anchored, window)
    lowest = _seeds(points, usable, window)
    if len(found) >= 3:
        distance, _ = Triangles(points[found]).seen(points[lowest])
        lowest = lowest[distance < 0]
    together = np.zeros(len(points), dtype=bool)
    together[found], together[lowest] = True, True
    return _without_crowns(points, np.flatnonzero(together))


def _seeds(points: Float, usable: Bool, window: float) -> Index:
    """The lowest usable candidates of windows, without those in crowns."""
    index = np.flatnonzero(usable)
    if not len(index):
        return index
    return _without_crowns(points, index[lowest_of_cells(points[index], window)])


def _without_crowns(points: Float, index: Index) -> Index:
    """Seeds without those that stand steeply over their neighbours."""
    for _ in range(10):
        if len(index) < 4:
            break
        place = points[index]
        distance, neighbour = cKDTree(place[:, :2]).query(place[:, :2], k=min(7, len(index)))
        rise = place[:, None, 2] - place[neighbour[:, 1:], 2]
        steepness = np.sort(np.degrees(np.arctan2(rise, distance[:, 1:])), axis=1)
        high = steepness[:, 1] > MAX_SEED_SLOPE_DEG
        if not high.any():
            break
        index = index[~high]
    return index


def _pits(points: Float) -> Bool:
    """(n,) candidates far and steeply below all of their neighbours."""
    if len(points) < 9:
        return np.zeros(len(points), dtype=bool)
    distance, neighbour = cKDTree(points[:, :2]).query(points[:, :2], k=9)
    rise = points[neighbour[:, 1:], 2] - points[:, None, 2]
    deepest = MAX_PIT_DEPTH_M + math.tan(math.radians(MAX_PIT_SLOPE_DEG)) * distance[:, 1:]
    return np.asarray((rise > deepest).all(axis=1), dtype=np.bool_)


def _rim(points: Float) -> Float:
    """(m, 2) places around the points, so that every point lies within a triangle."""
    low, high = least(points[:, :2]) - _EDGE_M, greatest(points[:, :2]) + _EDGE_M
    step = np.linspace(0.0, 1.0, _EDGE_POINTS, endpoint=False)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    sides = [a + step[:, None] * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
    return np.vstack(sides)


def _lowest(xyz: Float, key: Index) -> Index:
    """Index of the lowest of the points (n, 3) of each ``key`` (n,), these ascending.

    Among those at one height it is the one with the least coordinates, whatever the order in the file.
    """
    found, place, _ = distinct(key)
    tied = np.flatnonzero(xyz[:, 2] == lowest_heights(place, xyz[:, 2], len(found))[place])
    tied = tied[np.lexsort((xyz[tied, 1], xyz[tied, 0], place[tied]))]
    return np.asarray(tied[first_of_runs(place[tied])], dtype=np.int64)
