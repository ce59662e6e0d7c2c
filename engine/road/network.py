"""Roads with chainages, and where a shape lies on them (linear referencing)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely import STRtree
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from ..core.arrays import Float
from .chainages import STYLES, as_text, range_text

LEFT, RIGHT, BOTH = "left", "right", "both"
"""Side of the road in the direction of growing chainage; both where a shape lies on the axis itself."""
_END_M = 0.5  # metres that a shape may lie beyond the end of a road and still be at it
_MOST_STEPS = 2000  # pieces that an outline is looked at in
_STEP_M = 0.5
_SAME_M = 0.01
_NODE_M = 1e-6  # metres that rounding may put a foot off a node


@dataclass(frozen=True)
class Stretch:
    """A connected part of one road in the direction of growing chainage.

    Attributes:
        route, carriageway: names of the road; empty where they are not known.
        line: its axis, metres.
        along, chain: (n,) distances from its beginning and chainages there, metres, ``along`` ascending. Chainage is
            linear between them; where it jumps (an equation) one distance stands there twice.
    """

    route: str
    carriageway: str
    line: LineString
    along: Float
    chain: Float

    @property
    def road(self) -> str:
        """How the road is called."""
        return " ".join(word for word in (self.route, self.carriageway) if word)

    def chainage(self, along: float, *, ahead: bool) -> float:
        """Chainage at a distance; at an equation that ahead of it, or that behind it."""
        last = len(self.along) - 2
        if ahead:
            i = int(np.searchsorted(self.along, along + _NODE_M, side="right")) - 1
        else:
            i = int(np.searchsorted(self.along, along - _NODE_M, side="left")) - 1
        i = min(max(i, 0), last)
        length = float(self.along[i + 1] - self.along[i])
        share = 0.0 if length == 0 else (along - float(self.along[i])) / length
        return float(self.chain[i] + min(max(share, 0.0), 1.0) * (self.chain[i + 1] - self.chain[i]))


@dataclass(frozen=True)
class Place:
    """Where a shape lies: chainages (m) of its first and last point in the road's direction, the side, and distances.

    ``offset`` (m) is that of its nearest point to the axis, ``offset_mid`` that of its centroid.
    """

    route: str
    carriageway: str
    chain_from: float
    chain_to: float
    side: str
    offset: float
    offset_mid: float
    text: str


@dataclass(frozen=True)
class _Feet:
    """The feet of a shape's points on a stretch, as distances from its beginning."""

    stretch: Stretch
    distance: float
    begin: float
    end: float
    part: LineString
    beyond: bool
    """All of the shape lies beyond an end of the stretch."""
    middle_beyond: bool
    again: float | None
    """Another place on the same stretch that is as near, where there is one."""


@dataclass(frozen=True)
class Network:
    """Roads to place shapes on.

    Attributes:
        stretches: all of them.
        reach: metres from an axis within which a shape belongs to it.
        tolerance: metres within which two roads are equally near.
        style, unit: of chainages in texts, see ``chainages.as_text``.
    """

    stretches: tuple[Stretch, ...]
    reach: float = 200.0
    tolerance: float = 1.0
    style: str = STYLES[0]
    unit: str = "m"
    _tree: STRtree = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_tree", STRtree([s.line for s in self.stretches]))

    def place_of(self, shape: BaseGeometry | None) -> Place | str:
        """Where a shape lies, or a sentence that says why that is not known.

        The road is that whose axis is nearest, among those that have a foot of a perpendicular from the shape; a shape
        that lies on several goes to the one that is nearest to its centroid.
        """
        if shape is None or shape.is_empty:
            return "It has no shape."
        near = self._tree.query(shape, predicate="dwithin", distance=self.reach + self.tolerance)
        feet = sorted(
            (_feet(self.stretches[i], shape, self.tolerance) for i in near),
            key=lambda f: (f.distance, f.stretch.road, f.begin),
        )
        feet = [f for f in feet if f.distance <= self.reach]
        if not feet:
            return f"It lies farther than {self.reach:g} m from every road."
        reached = [f for f in feet if not f.beyond]
        if not reached:
            first = feet[0]
            end = first.stretch.chainage(first.begin, ahead=True)
            return f"It lies beyond the end of {self._named(first.stretch, end)}."
        return self._chosen(reached, shape)

    def _chosen(self, reached: list[_Feet], shape: BaseGeometry) -> Place | str:
        tied = [f for f in reached if f.distance - reached[0].distance <= self.tolerance]
        if len(tied) > 1:
            # the road goes on under another name: the part that the middle has its foot on
            tied = [f for f in tied if not f.middle_beyond] or tied
        if len(tied) > 1 and all(f.distance == 0 for f in tied):
            by_middle = sorted(tied, key=lambda f: f.stretch.line.distance(shape.centroid))
            first, second = (f.stretch.line.distance(shape.centroid) for f in by_middle[:2])
            tied = by_middle[:1] if second - first > self.tolerance else by_middle
        if len(tied) > 1:
            a, b = (self._named(f.stretch, f.stretch.chainage(f.begin, ahead=True)) for f in tied[:2])
            return f"It lies equally near to {a} and {b}."
        chosen = tied[0]
        if chosen.again is not None:
            a, b = (self._named(chosen.stretch, chosen.stretch.chainage(s, ahead=True)) for s in _pair(chosen))
            return f"It lies equally near to {a} and {b}."
        return self._place(chosen, shape)

    def _place(self, feet: _Feet, shape: BaseGeometry) -> Place:
        stretch = feet.stretch
        begin, end = stretch.chainage(feet.begin, ahead=True), stretch.chainage(feet.end, ahead=False)
        if feet.begin == feet.end:
            end = begin
        side = BOTH if feet.distance == 0 else side_of(shape.representative_point(), feet.part)
        words = range_text(begin, end, self.style, self.unit)
        return Place(
            stretch.route, stretch.carriageway, round(begin, 2), round(end, 2), side, round(feet.distance, 2),
            round(float(feet.part.distance(shape.centroid)), 2), f"{stretch.road} {words}".strip(),
        )  # fmt: skip

    def _named(self, stretch: Stretch, chain: float) -> str:
        return f"{stretch.road or 'the road'} at {as_text(chain, self.style, self.unit)}"

    def distance(self, shape: BaseGeometry) -> float:
        """Metres from a shape to the nearest road."""
        return float(min(s.line.distance(shape) for s in self.stretches))


def _pair(feet: _Feet) -> tuple[float, float]:
    assert feet.again is not None
    return feet.begin, feet.again


def _feet(stretch: Stretch, shape: BaseGeometry, tolerance: float) -> _Feet:
    """Feet of a shape on the part of a stretch around its nearest point.

    Only that part counts, two of the shape's widths to both sides: another bend of the same road is another place. It
    reaches so far that a straight road's distance grows by more than ``tolerance`` within it.
    """
    line = stretch.line
    length = float(line.length)
    nearest = shapely.get_point(shapely.shortest_line(line, shape), 0)
    anchor = float(line.project(nearest))
    west, south, east, north = shape.bounds
    distance = float(line.distance(shape))
    width = 2.0 * math.hypot(east - west, north - south) + 5.0 + math.sqrt(tolerance * (2.0 * distance + tolerance))
    low, high = max(anchor - width, 0.0), min(anchor + width, length)
    part = line if (low, high) == (0.0, length) else substring(line, low, high)
    points = _outline(shape)
    feet = low + shapely.line_locate_point(part, shapely.points(points))
    begin, end = float(feet.min()), float(feet.max())
    again = None
    for first, last, own in ((0.0, low, low), (high, length, high)):
        if last - first > 0:
            rest = substring(line, first, last)
            foot = first + float(rest.project(shapely.get_point(shapely.shortest_line(rest, shape), 0)))
            # where it begins it is the same bend, which goes on
            if rest.distance(shape) - distance <= tolerance and abs(foot - own) > _SAME_M:
                again = foot
    beyond = _beyond(line, points, begin, end)
    middle = shapely.get_coordinates(shape.centroid)
    foot = float(line.project(shape.centroid))
    return _Feet(stretch, distance, begin, end, part, beyond, _beyond(line, middle, foot, foot), again)


def _outline(shape: BaseGeometry) -> Float:
    """Points (n, 2) along a shape's lines, close enough that feet on bends are met."""
    step = max(_STEP_M, float(shape.length) / _MOST_STEPS)
    coordinates: Float = shapely.get_coordinates(shapely.segmentize(shape, step) if shape.length > 0 else shape)
    return coordinates


def _beyond(line: LineString, points: Float, begin: float, end: float) -> bool:
    """Whether all points lie past an end of an open line, in its direction there."""
    if line.is_ring:
        return False
    corners = shapely.get_coordinates(line)
    # feet on a part of the line, counted from its start, miss the line's end by the last digits
    first, last = end <= _SAME_M, begin >= line.length - _SAME_M
    for at_end, tip, inner in ((first, corners[0], corners[1]), (last, corners[-1], corners[-2])):
        if at_end:
            outward = (tip - inner) / np.hypot(*(tip - inner))
            return bool(np.min((points - tip) @ outward) > _END_M)
    return False


def side_of(point: BaseGeometry, line: LineString) -> str:
    """Left or right of a line in its direction, by the piece of it that is nearest to the point."""
    corners = shapely.get_coordinates(line)
    pieces = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))
    distances = shapely.distance(pieces, point)
    nearest = np.flatnonzero(distances <= distances.min() * (1 + 1e-9))
    own = shapely.get_coordinates(point)[0]
    # at a corner two pieces are equally near: that which the point lies more square to decides
    crosses = []
    for number in nearest:
        forward, across = corners[number + 1] - corners[number], own - corners[number]
        length = float(np.hypot(*forward))
        if length > 0:
            crosses.append((forward[0] * across[1] - forward[1] * across[0]) / length)
    return LEFT if max(crosses, key=abs, default=0.0) > 0 else RIGHT


def places_of(network: Network, shapes: Sequence[BaseGeometry | None]) -> list[Place | str]:
    """``place_of`` each shape."""
    return [network.place_of(shape) for shape in shapes]
