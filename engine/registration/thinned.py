"""Squares of large clouds that are registered in place of all their points.

A registration takes 150,000 points of each survey at most, wherever so many are. More squares than these need cost
memory and time and fix nothing better. Squares are whole pieces of surface: voxels, planes and patches within them are
what they are in the whole cloud.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Bool, Float, Index
from ..geometry.square_counts import counted
from ..pointcloud.in_parts import Points, SpooledCloud, bounds_of, parts_of
from ..pointcloud.plant_cover import PlantCover

MAX_POINTS = 4_000_000
"""Points of a survey up to which all of them are registered."""
_MIN_SIDE_M, _SIDE_OFFSETS, _MIN_SQUARES_ACROSS = 12.0, 10.0, 20.0
_MIN_SQUARES, _MIN_HALVED_OFFSETS = 12, 3.0  # fewer squares are made smaller, down to so many offsets
# Of a sequence with low discrepancy in two dimensions (Roberts 2018, the plastic number): however few squares are
# taken in the order of these values, they lie evenly.
_STEPS = 0.7548776662466927, 0.5698402909980532

Survey = tuple[Points, PlantCover | None]
Held = tuple[Float, PlantCover | None]


@dataclass(frozen=True)
class Squares:
    """Squares of ``side`` metres whose corners are its multiples; ``taken`` (k,) are their numbers, ascending."""

    side: float
    taken: Index

    def holds(self, xyz: Float) -> Bool:
        """Which of the points (n, 3) lie in a square that is taken."""
        return np.isin(square_of(xyz, self.side), self.taken)


def square_of(xyz: Float, side: float) -> Index:
    """Number (n,) of the square that each point (n, 2+) lies in."""
    place = np.floor(xyz[:, :2] / side).astype(np.int64)
    return np.asarray((place[:, 0] << 32) + place[:, 1], dtype=np.int64)


def evenly_chosen(
    surveys: tuple[Points, Points], offset: float, stable: BaseGeometry | None, most: int
) -> Squares | None:
    """Squares that hold at most about ``most`` points of either survey; None where all of them are no more.

    They depend on the points alone, not on how these are read. Where an area is known to be stable, half of the points
    are taken from the squares that reach it.

    Args:
        surveys: points (n, 3) and (m, 3), metres, in one reference system.
        offset: largest one expected between them, metres; squares are so much larger that each survey has most of the
            ground of the other's.
    """
    if max(len(points) for points in surveys) <= most:
        return None
    ends = [bounds_of(points) for points in surveys]
    extent = max(float((high - low)[:2].max()) for low, high in ends)
    side = float(np.clip(_SIDE_OFFSETS * offset, _MIN_SIDE_M, max(extent / _MIN_SQUARES_ACROSS, _MIN_SIDE_M)))
    while True:
        squares = _chosen(surveys, side, stable, most)
        if len(squares.taken) >= _MIN_SQUARES or side / 2 < _MIN_HALVED_OFFSETS * offset:
            return squares
        side /= 2


def _chosen(surveys: tuple[Points, Points], side: float, stable: BaseGeometry | None, most: int) -> Squares:
    tables = [counted(square_of(xyz, side) for xyz in parts_of(points)) for points in surveys]
    numbers = np.union1d(tables[0][0], tables[1][0])
    counts = np.zeros((2, len(numbers)), dtype=np.int64)
    for row, (found, points) in zip(counts, tables, strict=True):
        row[np.searchsorted(numbers, found)] = points
    fullest = counts.max(axis=0)
    order = np.lexsort((numbers, _even_order(numbers)))
    if stable is None:
        return Squares(side, _first_of(order, numbers, fullest, most))
    reaching = _reach(stable, numbers, side)[order]
    near = _first_of(order[reaching], numbers, fullest, most // 2)
    return Squares(side, np.union1d(near, _first_of(order[~reaching], numbers, fullest, most // 2)))


def points_in(squares: Squares | None, survey: Survey) -> Held:
    """The survey's points in the squares, in the cloud's order, and the plants over them; without squares all."""
    points, cover = survey
    if not isinstance(points, SpooledCloud):
        if squares is None:
            return points, cover
        chosen = squares.holds(points)
        return points[chosen], None if cover is None else _of(cover, chosen)
    places, covers = [], []
    for xyz, of_part in points.parts():
        chosen = np.ones(len(xyz), dtype=bool) if squares is None else squares.holds(xyz)
        places.append(xyz[chosen])
        if of_part is not None:
            covers.append(_of(of_part, chosen))
    return np.concatenate(places), _joined(covers)


def _even_order(numbers: Index) -> Float:
    """Values (k,) of the squares, 0 to 1, by which they are taken."""
    rows = ((numbers & 0xFFFFFFFF) + (1 << 31) & 0xFFFFFFFF) - (1 << 31)
    return np.asarray(((numbers - rows >> 32) * _STEPS[0] + rows * _STEPS[1]) % 1.0)


def _first_of(order: Index, numbers: Index, counts: Index, most: int) -> Index:
    """Numbers of the first squares in an order that together hold at most so many points, one at least."""
    held = np.cumsum(counts[order])
    return np.sort(numbers[order[: max(int(np.searchsorted(held, most, side="right")), 1)]])


def _reach(area: BaseGeometry, numbers: Index, side: float) -> Bool:
    """Which of the squares (k,) the area reaches."""
    rows = ((numbers & 0xFFFFFFFF) + (1 << 31) & 0xFFFFFFFF) - (1 << 31)
    west, south = (numbers - rows >> 32) * side, rows * side
    found: Bool = shapely.intersects(area, shapely.box(west, south, west + side, south + side))
    return found


def _of(cover: PlantCover, chosen: Bool) -> PlantCover:
    return PlantCover(cover.error[chosen], None if cover.height is None else cover.height[chosen])


def _joined(covers: list[PlantCover]) -> PlantCover | None:
    if not covers:
        return None
    heights = [cover.height for cover in covers if cover.height is not None]
    return PlantCover(np.concatenate([c.error for c in covers]), np.concatenate(heights) if heights else None)
