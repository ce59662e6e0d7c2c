"""What a registration does to every point in every step: neighbours that are kept, pairs, moments of neighbourhoods.

Each is written as a loop and as numpy's way with the same result, bit for bit (``core/compiled.py``): sums of three
products are taken as first and third, then second, in both.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.arrays import Bool, Float, Index
from ..core.compiled import compiled


def along(one: Float, two: Float) -> Float:
    """(n,) scalar products of (n, 3) vectors."""
    return np.asarray((one[:, 0] * two[:, 0] + one[:, 2] * two[:, 2]) + one[:, 1] * two[:, 1])


def _turned(vectors: Float, rotation: Float) -> Float:
    return np.stack([along(vectors, np.broadcast_to(row, vectors.shape)) for row in rotation], axis=1)


def _plain_kept(
    points: Float,
    kept: tuple[Float, Index, Float, Float],
    which: Index,
    places: Float,
    reach: float,
) -> tuple[Float, Index, Bool]:
    place, near, slack, beyond = kept
    none = len(points)
    number, distance = np.take(near[:, 0], which), np.full(len(which), np.inf)
    moved = _distance(places, np.take(place, which, axis=0))
    sure = moved < np.take(slack, which) - np.where(number < none, 0.0, reach)
    known = np.flatnonzero(sure & (number < none))
    distance[known] = _distance(places[known], points[number[known]])
    stale = np.flatnonzero(~sure)
    best, chosen = np.full(len(stale), np.inf), np.full(len(stale), none, dtype=np.int64)
    candidates = np.take(near, which[stale], axis=0)
    for rank in range(near.shape[1]):
        away = _distance(places[stale], np.take(points, candidates[:, rank], axis=0, mode="clip"))
        nearer = (candidates[:, rank] < none) & (away < best)
        best[nearer], chosen[nearer] = away[nearer], candidates[nearer, rank]
    number[stale], distance[stale] = chosen, best
    sure[stale] = np.minimum(best, reach) < np.take(beyond, which[stale]) - moved[stale]
    far = ~(distance < reach)
    distance[far], number[far] = np.inf, none
    return distance, number, sure


def _distance(one: Float, two: Float) -> Float:
    offset = one - two
    return np.asarray(np.sqrt(along(offset, offset)))


@compiled(_plain_kept)
def kept_neighbours(
    points: Float,
    kept: tuple[Float, Index, Float, Float],
    which: Index,
    places: Float,
    reach: float,
) -> tuple[Float, Index, Bool]:
    """Nearest of the points that were found before, and where none that was not found can be nearer.

    Args:
        points: (p, 3) among which neighbours are looked for.
        kept: of each point that looks (m): where it looked from (m, 3), what it found (m, k), nearest first, p for
            nothing; how far it may move and keep the first; how far away all others were at least, metres.
        which: (n,) the points that look now, of m.
        places: (n, 3) where they are.
        reach: farthest neighbour, metres.

    Returns:
        (n,) distances, infinity without; (n,) numbers, p without; (n,) where that is sure.
    """
    place, near, slack, beyond = kept
    none = len(points)
    distance, number = np.empty(len(which)), np.empty(len(which), dtype=np.int64)
    sure = np.empty(len(which), dtype=np.bool_)
    for i in range(len(which)):
        own = which[i]
        x, y, z = places[i, 0] - place[own, 0], places[i, 1] - place[own, 1], places[i, 2] - place[own, 2]
        moved = np.sqrt((x * x + z * z) + y * y)
        first = near[own, 0]
        keeps = moved < slack[own] - (0.0 if first < none else reach)
        best, chosen = np.inf, none
        for rank in range(1 if keeps else near.shape[1]):
            other = near[own, rank]
            if other < none:
                x, y, z = (
                    places[i, 0] - points[other, 0],
                    places[i, 1] - points[other, 1],
                    places[i, 2] - points[other, 2],
                )
                away = np.sqrt((x * x + z * z) + y * y)
                if away < best:
                    best, chosen = away, other
        sure[i] = keeps or min(best, reach) < beyond[own] - moved
        if not best < reach:
            best, chosen = np.inf, none
        distance[i], number[i] = best, chosen
    return distance, number, sure


def _plain_moments(points: Float, numbers: Index, near: Index) -> Float:
    own = points[numbers].T
    offsets = [np.take(np.ascontiguousarray(points[:, i]), near.T) - own[i] for i in range(3)]
    mean = [_in_order(offset) / near.shape[1] for offset in offsets]
    x, y, z = (offset - middle for offset, middle in zip(offsets, mean, strict=True))
    pairs = ((x, x), (y, y), (z, z), (x, y), (x, z), (y, z))
    return np.stack([*(own + mean), *(_in_order(one * two) for one, two in pairs)])


def _in_order(values: Float) -> Float:
    """Sums (n,) of (k, n) row by row: numpy's own sum takes another order where n is 1."""
    total = np.zeros(values.shape[1])
    for row in values:
        total += row
    return total


@compiled(_plain_moments)
def neighbourhood_moments(points: Float, numbers: Index, near: Index) -> Float:
    """Means (3 rows) and sums of products about them (xx, yy, zz, xy, xz, yz) of neighbourhoods, (9, n).

    Args:
        points: (p, 3). numbers: (n,) of the points whose neighbourhoods they are. near: (n, k) numbers of theirs.
    """
    count = near.shape[1]
    found = np.zeros((9, len(numbers)))
    offset = np.empty((count, 3))
    mean = np.empty(3)
    for i in range(len(numbers)):
        own = numbers[i]
        mean[:] = 0.0
        for k in range(count):
            for j in range(3):
                offset[k, j] = points[near[i, k], j] - points[own, j]
                mean[j] += offset[k, j]
        for j in range(3):
            mean[j] /= count
            found[j, i] = points[own, j] + mean[j]
        for k in range(count):
            x, y, z = offset[k, 0] - mean[0], offset[k, 1] - mean[1], offset[k, 2] - mean[2]
            found[3, i] += x * x
            found[4, i] += y * y
            found[5, i] += z * z
            found[6, i] += x * y
            found[7, i] += x * z
            found[8, i] += y * z
    return found


#: Points, centroids and normals (m, 3) of a surface, and where it is planar (m,).
Planes = tuple[Float, Float, Float, Bool]


def _plain_pairs(
    sources: Index,
    number: Index,
    surfaces: tuple[Planes, Planes],
    motion: tuple[Float, Float],
    first_moves: bool,
    agreement: float,
) -> tuple[Float, Float, Float, Float, Index]:
    (points, centroids, normals, planar), (_, middles, others, flat) = surfaces
    rotation, translation = motion

    def at(values: Float, numbers: Index, moves: bool) -> Float:
        found = np.take(values, numbers, axis=0)
        return _turned(found, rotation) + translation if moves else found

    def turned(values: Float, numbers: Index, moves: bool) -> Float:
        found = np.take(values, numbers, axis=0)
        return _turned(found, rotation) if moves else found

    own, other = turned(others, number, not first_moves), turned(normals, sources, first_moves)
    cosine = along(own, other)
    both = own + np.where(cosine < 0, -1.0, 1.0)[:, None] * other
    keep = np.flatnonzero((np.abs(cosine) > agreement) & flat[number] & planar[sources])
    both, sources, number = both[keep], sources[keep], number[keep]
    normal = both / np.sqrt(along(both, both))[:, None]
    place = at(points, sources, first_moves)
    plane = at(middles, number, not first_moves)
    around = (place + at(centroids, sources, first_moves)) / 2
    return place, normal, along(place - plane, normal), along(around - plane, normal), sources


@compiled(_plain_pairs)
def plane_pairs(
    sources: Index,
    number: Index,
    surfaces: tuple[Planes, Planes],
    motion: tuple[Float, Float],
    first_moves: bool,
    agreement: float,
) -> tuple[Float, Float, Float, Float, Index]:
    """Points ``sources`` (n,) of the first surface against the planes ``number`` (n,) of the second.

    Args:
        motion: rotation (3, 3) and translation (3,) of the first surface if ``first_moves``, else of the second.
        agreement: least cosine between both normals.

    Returns:
        What ``point_to_plane.Pairs`` holds, of those that agree: places, normals, residuals, gaps, sources.
    """
    (points, centroids, normals, planar), (_, middles, others, flat) = surfaces
    rotation, translation = motion
    size = len(sources)
    place, normal = np.empty((size, 3)), np.empty((size, 3))
    residual, gap = np.empty(size), np.empty(size)
    kept = np.empty(size, dtype=np.int64)
    moved, plain = np.empty((3, 3)), np.empty((3, 3))
    count = 0
    for i in range(size):
        a, b = sources[i], number[i]
        if not (planar[a] and flat[b]):
            continue
        if first_moves:
            moved[0], moved[1], moved[2] = normals[a], points[a], centroids[a]
            plain[0], plain[1] = others[b], middles[b]
        else:
            moved[0], moved[1] = others[b], middles[b]
            plain[0], plain[1], plain[2] = normals[a], points[a], centroids[a]
        for k in range(3):
            x, y, z = moved[k, 0], moved[k, 1], moved[k, 2]
            for j in range(3):
                value = (x * rotation[j, 0] + z * rotation[j, 2]) + y * rotation[j, 1]
                moved[k, j] = value if k == 0 else value + translation[j]
        mine, theirs = (moved, plain) if first_moves else (plain, moved)
        cosine = (theirs[0, 0] * mine[0, 0] + theirs[0, 2] * mine[0, 2]) + theirs[0, 1] * mine[0, 1]
        if not abs(cosine) > agreement:
            continue
        sign = -1.0 if cosine < 0 else 1.0
        u, v, w = theirs[0, 0] + sign * mine[0, 0], theirs[0, 1] + sign * mine[0, 1], theirs[0, 2] + sign * mine[0, 2]
        length = np.sqrt((u * u + w * w) + v * v)
        u, v, w = u / length, v / length, w / length
        x, y, z = mine[1, 0] - theirs[1, 0], mine[1, 1] - theirs[1, 1], mine[1, 2] - theirs[1, 2]
        residual[count] = (x * u + z * w) + y * v
        x = (mine[1, 0] + mine[2, 0]) / 2 - theirs[1, 0]
        y = (mine[1, 1] + mine[2, 1]) / 2 - theirs[1, 1]
        z = (mine[1, 2] + mine[2, 2]) / 2 - theirs[1, 2]
        gap[count] = (x * u + z * w) + y * v
        for j in range(3):
            place[count, j] = mine[1, j]
        normal[count, 0], normal[count, 1], normal[count, 2] = u, v, w
        kept[count] = a
        count += 1
    return place[:count], normal[:count], residual[:count], gap[:count], kept[:count]


def as_planes(points: Float, centroids: Float, normals: Float, planar: Bool) -> Planes:
    """A surface as the kernels take it: arrays that lie in rows, of one type each."""
    values: list[Any] = [np.ascontiguousarray(array, dtype=np.float64) for array in (points, centroids, normals)]
    return values[0], values[1], values[2], np.ascontiguousarray(planar, dtype=bool)
