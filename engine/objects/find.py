"""Objects that appeared or vanished between two surveys in one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Index
from .base import NEIGHBOURS, Base
from .candidates import LOW_M, MIN_HEIGHT_M, Heights, changed_returns, groups, link_length
from .evidence import Counts, Place, core, footprint, likelihood_ratio, pit_below
from .shapes import Shape, shape_of
from .survey import Survey

MAX_CHANCE = 0.005
"""Likelihood ratio up to which a group of returns is taken as new: four returns on it against four through it."""
_MIN_RETURNS, _MIN_OPEN_RETURNS = 3, 8
MAX_SOLID_M, STEP_M = 4.0, 0.4
"""What stands higher is no boulder, wall or vehicle; step in height that a closed surface has between its returns."""
FLAT_TOP = 0.75
"""Least share of an object's height at which its lowest return lies if its top is flat."""
MAX_BENEATH, MAX_AROUND, MIN_ENDED = 0.1, 0.3, 0.9
"""Shares of a closed body's returns: below and between its own, below within its rim, last of their pulse."""
_RIM_SPACINGS = 0.5
"""Width, in spacings, of the rim that a footprint has around its outermost returns."""


@dataclass(frozen=True)
class Found:
    """One group of returns of one survey that the other survey lacks.

    ``returns`` are the owner's. ``owner`` and ``other`` count both surveys' returns over the footprint; ``beneath`` the
    owner's below and between those of the object, of which a share of ``ended`` are the last of their pulse. ``seen``
    is the share of the footprint that the other survey's returns reach, by its spacing; ``pit`` that of ``pit_below``.
    """

    appeared: bool
    returns: Index
    area: BaseGeometry
    shape: Shape
    owner: Counts
    other: Counts
    seen: float
    beneath: int
    ended: float
    pit: float

    @property
    def closed(self) -> bool:
        """Whether pulses end on it and none goes through."""
        between = self.beneath / (len(self.returns) + self.beneath)
        around = self.owner.through / (self.owner.hits + self.owner.through)
        return between <= MAX_BENEATH and around <= MAX_AROUND and self.ended >= MIN_ENDED

    @property
    def chance(self) -> float:
        return likelihood_ratio(self.owner, self.other)


def find_groups(first: Survey, later: Survey) -> list[Found]:
    """Groups that appeared, then those that vanished, each in a fixed order."""
    found = []
    for appeared, owner, other in ((True, later, first), (False, first, later)):
        if min(np.count_nonzero(owner.ground), np.count_nonzero(other.ground)) > NEIGHBOURS:
            found += _one_way(owner, other, appeared=appeared)
    return found


def _one_way(owner: Survey, other: Survey, *, appeared: bool) -> list[Found]:
    base = Base(other.xyz[other.ground])
    own, others = (Heights(survey, base.heights(survey.xyz)) for survey in (owner, other))
    changed = changed_returns(own, others)
    if not len(changed):
        return []
    link = link_length(owner.spacing)
    pair = Pair(owner, Place(own), Place(others), link, appeared)
    ended = owner.last[changed] & (own.height[changed] <= MAX_SOLID_M)
    closed = [one for one in pair.found(changed[ended], STEP_M, _MIN_RETURNS) if one.closed]
    closed = pair.joined(closed)
    left = np.setdiff1d(changed, np.concatenate([one.returns for one in closed] or [changed[:0]]))
    return closed + pair.found(left, link, _MIN_OPEN_RETURNS)


@dataclass(frozen=True)
class Pair:
    """The survey that holds objects, and the other one; returns closer than about ``link`` m are of one object."""

    survey: Survey
    owner: Place
    other: Place
    link: float
    appeared: bool

    def found(self, chosen: Index, step: float, least_returns: int) -> list[Found]:
        """What surely changed of the returns ``chosen`` (n,), in groups with steps of height up to ``step`` m."""
        places = np.column_stack([self.survey.xyz[chosen, :2], self.owner.heights[chosen]])
        sides = np.array([self.link / 1.5, self.link / 1.5, step])
        parts = [np.sort(chosen[part]) for part in groups(places, sides) if len(part) >= least_returns]
        return [one for one in map(self._one, parts) if one is not None]

    def joined(self, closed: list[Found]) -> list[Found]:
        """The same with parts of one flat top as one: few returns may leave gaps in a wall."""
        flat = [one for one in closed if one.shape.lowest >= FLAT_TOP * one.shape.height]
        parts = [one for one in closed if one.shape.lowest < FLAT_TOP * one.shape.height]
        while flat:
            one = flat.pop(0)
            near = [k for k, other in enumerate(flat) if self._continues(one, other)]
            whole = self._one(np.union1d(one.returns, flat[near[0]].returns)) if near else None
            if whole is not None and whole.closed:
                flat[near[0]] = whole
            else:
                parts.append(one)
        return parts

    def _continues(self, one: Found, other: Found) -> bool:
        step = abs(one.shape.height - other.shape.height)
        return step <= STEP_M / 2 and one.area.distance(other.area) <= self.link

    def _one(self, part: Index) -> Found | None:
        xyz, height = self.survey.xyz[part], self.owner.heights[part]
        inner = core(xyz[:, :2], self.link)
        area = footprint(xyz[:, :2], inner, _RIM_SPACINGS * self.survey.spacing)
        low, top = max(LOW_M, float(height.min()) / 2), float(height.max()) + MIN_HEIGHT_M
        own, other = (place.counts(area, low, top) for place in (self.owner, self.other))
        if likelihood_ratio(own, other) > MAX_CHANCE or own.hits * other.through <= other.hits * own.through:
            return None
        return Found(
            appeared=self.appeared,
            returns=part,
            area=area,
            shape=shape_of(xyz, height, area),
            owner=own,
            other=other,
            seen=(other.hits + other.through) * self.other.spacing**2 / area.area,
            beneath=self.owner.counts(inner, low, top).through,
            ended=self._ended(area, low, top),
            pit=pit_below(self.other, area),
        )

    def _ended(self, area: BaseGeometry, low: float, top: float) -> float:
        within = self.owner.within(area)
        height = self.owner.heights[within]
        return float(self.survey.last[within[(height >= low) & (height <= top)]].mean())
