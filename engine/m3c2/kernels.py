"""Sums over the points of cylinders and balls as loops that numba compiles, one place after the other.

They find the points that ``Lattice.candidates`` gives, in its order, and add as numpy's ``add.reduceat`` does, so that
every figure has the bits of numpy's way in ``distances``, ``spread`` and ``normals``. No pairs of a place and a point
are held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.arrays import Float, Index
from ..core.compiled import Loop

MIN_COMPILED_PLACES = 60_000  # from which on loading the compiled loops pays for itself
PLACES_PER_CALL = 20_000  # so that progress is seen and cancelling takes effect in time
_LEAF = 128  # numbers that numpy adds in eight sums side by side; more are halved
_DEEPEST = 64  # halvings of what an array can hold


class Searched(NamedTuple):
    """What a loop needs of a ``Lattice``.

    ``points`` (3, n) are sorted by their cubes, as the cubes are by row, ``column`` (c,) and
    ``layer`` (c,); row k has those from
    ``row_cubes[k]`` on. ``cubes`` (c, 4) and ``parts`` (p, 4) are x, y, z and radius of spheres around the points of
    the cubes and of their eighths. Cube k has the parts from ``cube_members[k]`` to before ``cube_members[k + 1]``, and
    a part its points likewise. ``axes`` (3, 3) are those of columns, rows and layers, through ``origin`` (3,); ``low``
    (3,) is where these begin. ``shape`` are the numbers of columns and rows.
    """

    points: Float
    column: Index
    layer: Index
    row_cubes: Index
    cubes: Float
    cube_members: Index
    parts: Float
    part_members: Index
    axes: Float
    origin: Float
    low: Float
    cell: float
    shape: Index


def tree_leaf(values: Float, first: int, n: int) -> float:
    """The sum of at most 128 ``values`` from the ``first`` on, as numpy adds them."""
    if n < 8:
        total = -0.0
        for i in range(first, first + n):
            total += values[i]
        return total
    a, b, c, d = values[first], values[first + 1], values[first + 2], values[first + 3]
    e, f, g, h = values[first + 4], values[first + 5], values[first + 6], values[first + 7]
    whole = n - n % 8
    for i in range(first + 8, first + whole, 8):
        a, b, c, d = a + values[i], b + values[i + 1], c + values[i + 2], d + values[i + 3]
        e, f, g, h = e + values[i + 4], f + values[i + 5], g + values[i + 6], h + values[i + 7]
    total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(first + whole, first + n):
        total += values[i]
    return total


def tree_sum(values: Float, n: int) -> float:
    """The sum of the first ``n`` > 0 ``values`` as ``numpy.add.reduceat`` gives it: the first, and all others."""
    if n == 1:
        return values[0]
    if n - 1 <= _LEAF:
        return values[0] + tree_leaf(values, 1, n - 1)
    start, size = np.empty(2 * _DEEPEST, np.int64), np.empty(2 * _DEEPEST, np.int64)
    sums, top, depth = np.empty(2 * _DEEPEST), 0, 1
    start[0], size[0] = 1, n - 1
    while depth:
        depth -= 1
        first, many = start[depth], size[depth]
        if many < 0:  # both halves are known
            top -= 1
            sums[top - 1] += sums[top]
        elif many <= _LEAF:
            sums[top] = tree_leaf(values, first, many)
            top += 1
        else:
            half = many // 2
            half -= half % 8
            size[depth], start[depth + 1], size[depth + 1] = -1, first + half, many - half
            start[depth + 2], size[depth + 2] = first, half
            depth += 3
    return values[0] + sums[0]


def near_segment(sphere: Float, k: int, place: Float, axis: Float, inverse: float, reach: float) -> bool:
    """Whether sphere ``k`` of (m, 4) comes within ``reach`` of a segment."""
    x, y, z = sphere[k, 0] - place[0], sphere[k, 1] - place[1], sphere[k, 2] - place[2]
    t = min(max((x * axis[0] + y * axis[1] + z * axis[2]) * inverse, -1.0), 1.0)
    x, y, z = x - axis[0] * t, y - axis[1] * t, z - axis[2] * t
    far = sphere[k, 3] + reach
    return x * x + y * y + z * z <= far * far


def first_at_least(column: Index, wanted: int, low: int, high: int) -> int:
    """The place from ``low`` to before ``high`` of the first of the sorted ``column`` that is at least ``wanted``."""
    while low < high:
        middle = (low + high) // 2
        if column[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    return low


def in_frame(cloud: Searched, place: Float, axis: Float, k: int) -> tuple[float, float]:
    """Where a place lies along the cloud's axis ``k``, and what the segment's half axis has of it."""
    frame, at, x, y, z = cloud.axes[k], cloud.origin, place[0], place[1], place[2]
    along = frame[0] * (x - at[0]) + frame[1] * (y - at[1]) + frame[2] * (z - at[2])
    return along - cloud.low[k], frame[0] * axis[0] + frame[1] * axis[1] + frame[2] * axis[2]


def candidates_of(held: Index, cloud: Searched, place: Float, axis: Float, reach: float) -> int:
    """How many points can lie within ``reach`` of the segment of half ``axis`` around ``place``.

    They are entered into ``held`` (n,), in their order.
    """
    u, a = in_frame(cloud, place, axis, 0)
    v, b = in_frame(cloud, place, axis, 1)
    w, c = in_frame(cloud, place, axis, 2)
    squared = axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]
    inverse = 1.0 / squared if squared > 1e-300 else 0.0
    column, layer, cubes, parts = cloud.column, cloud.layer, cloud.cubes, cloud.parts
    cube_members, part_members = cloud.cube_members, cloud.part_members
    cell, found = cloud.cell, 0
    first = int(max(np.floor((v - abs(b) - reach) / cell), 0.0))
    last = int(min(np.floor((v + abs(b) + reach) / cell), cloud.shape[1] - 1.0))
    for row in range(first, last + 1):
        # the part of the segment, from -1 to 1 of its half length, that is near enough to the row
        below, above, start, stop = row * cell - v, (row + 1) * cell - v, -1.0, 1.0
        if b > 0:
            start, stop = max((below - reach) / b, -1.0), min((above + reach) / b, 1.0)
        elif b < 0:
            start, stop = max((above + reach) / b, -1.0), min((below - reach) / b, 1.0)
        gap = max(0.0, below - abs(b), -abs(b) - above)
        width = np.sqrt(max(reach * reach - gap * gap, 0.0))
        left = int(max(np.floor((u + min(start * a, stop * a) - width) / cell - 1e-9), 0.0))
        right = int(min(np.floor((u + max(start * a, stop * a) + width) / cell + 1e-9), cloud.shape[0] - 1.0))
        lowest = int(max(np.floor((w + min(start * c, stop * c) - reach) / cell - 1e-9), -1.0))
        highest = int(min(np.floor((w + max(start * c, stop * c) + reach) / cell + 1e-9), 2.0**40))
        end = cloud.row_cubes[row + 1]
        for cube in range(first_at_least(column, left, cloud.row_cubes[row], end), end):
            if column[cube] > right:
                break
            if layer[cube] < lowest or layer[cube] > highest:
                continue
            if near_segment(cubes, cube, place, axis, inverse, reach):
                for part in range(cube_members[cube], cube_members[cube + 1]):
                    if near_segment(parts, part, place, axis, inverse, reach):
                        for point in range(part_members[part], part_members[part + 1]):
                            held[found] = point
                            found += 1
    return found


def centred(values: Float, n: int) -> float:
    """The mean of the first ``n`` > 0 ``values``, which become what they are about it."""
    mean = tree_sum(values, n) / n
    for i in range(n):
        values[i] -= mean
    return mean


def product_sum(spare: Float, one: Float, other: Float, n: int) -> float:
    """The sum of the products of the first ``n`` > 0; ``spare`` is written over."""
    for i in range(n):
        spare[i] = one[i] * other[i]
    return tree_sum(spare, n)


def placed(to: Float, cloud: Searched, held: Index, n: int, middle: Float, direction: Float) -> None:
    """Where the first ``n`` points that are ``held`` lie in a ``direction`` from ``middle``."""
    for i in range(n):
        x, y = cloud.points[0, held[i]] - middle[0], cloud.points[1, held[i]] - middle[1]
        to[i] = x * direction[0] + y * direction[1] + (cloud.points[2, held[i]] - middle[2]) * direction[2]


def cylinder_sums(
    cloud: Searched,
    values: Float,
    places: tuple[Index, Float, Float],
    across: tuple[Float, Float],
    lengths: tuple[float, float, float],
    found: tuple[Index, Float, Float, Float, Float],
) -> None:
    """Enter what the points of cylinders give into ``found``, as ``distances.Cylinders`` has it.

    Args:
        values: (n,) a figure of each point, (0,) for none.
        places: numbers (k,) of the core points that are looked at; all core points (m, 3); their axes (m, 3).
        across: two directions (m, 3) across each axis; (0, 3) where the spread is not asked for.
        lengths: radius, half length, and how far around the segment points are looked for; metres.
        found: count (m,); mean and standard deviation (2, m) along the axis; mean value (m,) or (0,); place (m, 2) and
            products (m, 5) of ``spread.Spread``, (0, 2) and (0, 5) where not asked for.
    """
    (which, core, unit), (radius, half_length, reach) = places, lengths
    count, moments, value, place, products = found
    most = cloud.points.shape[1]
    held, along, spare, u, v = np.empty(most, np.int64), np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    for number in which:
        axis, middle, n = unit[number], core[number], 0
        near = candidates_of(held, cloud, middle, half_length * axis, reach)
        for i in range(near):
            point = held[i]
            x, y, z = cloud.points[0, point], cloud.points[1, point], cloud.points[2, point]
            x, y, z = x - middle[0], y - middle[1], z - middle[2]
            t = x * axis[0] + y * axis[1] + z * axis[2]
            x, y, z = x - axis[0] * t, y - axis[1] * t, z - axis[2] * t
            if abs(t) <= half_length and x * x + y * y + z * z <= radius * radius:
                held[n], along[n] = point, t
                n += 1
        count[number] = n
        if n == 0:
            continue
        if value.size:
            for i in range(n):
                spare[i] = values[held[i]]
            value[number] = tree_sum(spare, n) / n
        moments[0, number] = centred(along, n)
        if n > 1:
            moments[1, number] = np.sqrt(product_sum(spare, along, along, n) / (n - 1))
        if place.size:
            placed(u, cloud, held, n, middle, across[0][number])
            placed(v, cloud, held, n, middle, across[1][number])
            place[number, 0], place[number, 1] = centred(u, n), centred(v, n)
            for column, (one, other) in enumerate(((u, u), (v, v), (u, v), (u, along), (v, along))):
                products[number, column] = product_sum(spare, one, other, n)


def ball_sums(
    cloud: Searched, which: Index, core: Float, lengths: tuple[float, float], found: tuple[Index, Float]
) -> None:
    """Enter how many points balls hold (m,) and the scatter matrices (m, 3, 3) about their means into ``found``.

    Args:
        which: (k,) numbers of the places that are looked at, of all (m, 3).
        lengths: radius, and how far around points are looked for; metres.
    """
    (radius, reach), (count, scatter) = lengths, found
    most, still = cloud.points.shape[1], np.zeros(3)
    held, offset, spare = np.empty(most, np.int64), np.empty((3, most)), np.empty(most)
    for number in which:
        middle, n = core[number], 0
        near = candidates_of(held, cloud, middle, still, reach)
        for i in range(near):
            point = held[i]
            x, y, z = cloud.points[0, point], cloud.points[1, point], cloud.points[2, point]
            x, y, z = x - middle[0], y - middle[1], z - middle[2]
            if x * x + y * y + z * z <= radius * radius:
                offset[0, n], offset[1, n], offset[2, n] = x, y, z
                n += 1
        count[number] = n
        if n == 0:
            continue
        for row in range(3):
            centred(offset[row], n)
        for row in range(3):
            for column in range(row, 3):
                scatter[number, row, column] = product_sum(spare, offset[row], offset[column], n)
                scatter[number, column, row] = scatter[number, row, column]


_HELPERS = (
    tree_leaf, tree_sum, near_segment, first_at_least, in_frame, candidates_of, centred, product_sum, placed
)  # fmt: skip
CYLINDER_SUMS, BALL_SUMS = Loop(cylinder_sums, *_HELPERS), Loop(ball_sums, *_HELPERS)
