"""How surely a group of returns is new: pulses that ended there in one survey and went through in the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import Delaunay, QhullError, cKDTree
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Float, Index
from .candidates import LOW_M, MIN_HEIGHT_M, Heights

FLAT_TOP = 0.75
"""Least share of an object's height at which its lowest return lies if its top is flat."""
RING_M = 1.0
"""Width of the ring in which the ground around is looked at, and at least three spacings."""
_MIN_RING_POINTS = 8


@dataclass(frozen=True)
class Counts:
    """Returns of a survey over a footprint: on the object, and below it."""

    hits: int
    through: int


def likelihood_ratio(one: Counts, other: Counts) -> float:
    """How likely both counts are if one share of the pulses ends on the object in both surveys, against two shares.

    The generalised likelihood ratio of two binomial samples (Wilks 1938, doi:10.1214/aoms/1177732360), 0 to 1.
    """
    both = Counts(one.hits + other.hits, one.through + other.through)
    return float(np.exp(_log_likelihood(both) - _log_likelihood(one) - _log_likelihood(other)))


def _log_likelihood(counts: Counts) -> float:
    total = counts.hits + counts.through
    return sum(n * np.log(n / total) for n in (counts.hits, counts.through) if n)


def top_of(height: Float) -> float:
    """Height (m) of the top of returns (n,) so high over the ground."""
    return float(np.quantile(height, 0.95)) if len(height) >= 20 else float(height.max())


def is_flat(height: Float) -> bool:
    """Whether returns (n,) so high over the ground, m, are those of a flat top."""
    return bool(height.min() >= FLAT_TOP * top_of(height))


class Tops:
    """Heights (n,) m of the returns (n, 2) on an object; at a place that of the nearest one.

    What lies nearer to the ground than to the tops went through. Under a flat top nothing lies right below it, so all
    that is clearly lower did.
    """

    def __init__(self, xy: Float, height: Float) -> None:
        self._tree, self._height, self._flat = cKDTree(xy), height, is_flat(height)

    def at(self, xy: Float) -> Float:
        return np.asarray(self._height[self._tree.query(xy)[1]])

    def lowest(self, top: Float) -> Float:
        """Height (m) from which returns below a ``top`` (m) lie on the object."""
        return FLAT_TOP * top if self._flat else np.minimum(top / 2, MIN_HEIGHT_M)


class Place:
    """Returns of a survey around places, looked up from above."""

    def __init__(self, heights: Heights) -> None:
        self.heights, self.xyz = heights.height, heights.survey.xyz
        self.spacing = heights.survey.spacing
        self._tree = cKDTree(self.xyz[:, :2])

    def within(self, area: BaseGeometry) -> Index:
        """(m,) returns within an area, ascending."""
        if area.is_empty:
            return np.zeros(0, dtype=np.int64)
        west, south, east, north = area.bounds
        middle, reach = ((west + east) / 2, (south + north) / 2), np.hypot(east - west, north - south) / 2
        near = np.sort(np.array(self._tree.query_ball_point(middle, reach + 1e-6), dtype=np.int64))
        return near[shapely.contains_xy(area, *self.xyz[near, :2].T)] if len(near) else near

    def ground_around(self, area: BaseGeometry) -> tuple[Float, Float]:
        """Returns (n, 3) from the ground in an area and a ring around it, and their heights (n,), m."""
        near = self.within(_with_ring(area, self.spacing))
        near = near[np.abs(self.heights[near]) < MIN_HEIGHT_M]
        return self.xyz[near], self.heights[near]

    def split(self, area: BaseGeometry, tops: Tops) -> tuple[Index, Index]:
        """Returns over an area that lie on the tops there, and those that went through.

        Returns clearly over the tops, as of a crown, say nothing and are in neither.
        """
        within = self.within(area)
        height, top = self.heights[within], tops.at(self.xyz[within, :2])
        through = height < tops.lowest(top)
        return within[~through & (height <= top + MIN_HEIGHT_M)], within[through]

    def counts(self, area: BaseGeometry, tops: Tops) -> Counts:
        hits, through = self.split(area, tops)
        return Counts(len(hits), len(through))


def core(xy: Float, longest: float) -> BaseGeometry:
    """The triangles between points (n, 2), m, whose sides are at most ``longest`` m; empty if there are none."""
    if len(xy) < 3:
        return shapely.Polygon()
    try:
        triangles = xy[Delaunay(xy - xy.mean(axis=0)).simplices]
    except QhullError:  # points on a line
        return shapely.Polygon()
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    kept = triangles[sides <= longest]
    return shapely.coverage_union_all(shapely.polygons(kept)) if len(kept) else shapely.Polygon()


def footprint(xy: Float, inner: BaseGeometry, rim: float) -> BaseGeometry:
    """The core and its points (n, 2) with a ``rim`` (m) around."""
    return shapely.union_all([inner, shapely.multipoints(xy)]).buffer(rim, quad_segs=4)


def pit_below(other: Place, area: BaseGeometry) -> float:
    """How far (m) the other survey's ground in a footprint lies under that around; 0 if unknown.

    Ground that was taken away leaves a pit, an object does not.
    """
    ring = _with_ring(area, other.spacing).difference(area)
    outside, inside = (other.within(part) for part in (ring, area))
    outside, inside = (index[np.abs(other.heights[index]) < LOW_M] for index in (outside, inside))
    if len(outside) < _MIN_RING_POINTS or not len(inside):
        return 0.0
    middle = other.xyz[inside].mean(axis=0)
    design = np.column_stack([other.xyz[outside, :2] - middle[:2], np.ones(len(outside))])
    return float(np.linalg.lstsq(design, other.xyz[outside, 2] - middle[2], rcond=None)[0][2])


def _with_ring(area: BaseGeometry, spacing: float) -> BaseGeometry:
    return area.buffer(max(RING_M, 3.0 * spacing), quad_segs=4)
