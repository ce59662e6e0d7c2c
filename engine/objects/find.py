"""Objects that appeared or vanished between two surveys in one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Float, Index
from ..geometry.voxel_groups import groups
from .base import NEIGHBOURS, Base
from .candidates import MIN_HEIGHT_M, Heights, changed_returns, link_length
from .evidence import Counts, Place, Tops, core, footprint, is_flat, likelihood_ratio, pit_below
from .shapes import Shape, shape_of
from .survey import Survey

MAX_CHANCE = 0.0005
"""Likelihood ratio up to which a group of returns is taken as new: six returns on it against five through it.

By Wilks' theorem chance alone makes it once in 10,000 groups, and half a hectare of forest has 1,000."""
_MIN_RETURNS, _MIN_OPEN_RETURNS = 3, 8
MAX_SOLID_M, STEP_M = 4.0, 0.4
"""What stands higher is no boulder, wall or vehicle; step in height that a closed surface has between its returns."""
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
    solid = np.flatnonzero(owner.last & (own.height > MIN_HEIGHT_M) & (own.height <= MAX_SOLID_M))
    pair = Pair(owner, Place(own), Place(others), link_length(owner.spacing), solid, appeared)
    left = np.intersect1d(changed, solid)
    closed: list[Found] = []
    for wider, flat in ((2.0, True), (1.0, False)):
        closed += pair.closed(left, wider, flat=flat)
        left = np.setdiff1d(left, np.concatenate([one.returns for one in closed] or [left[:0]]))
    left = np.setdiff1d(changed, np.concatenate([one.returns for one in closed] or [changed[:0]]))
    return closed + pair.found(left, pair.link, _MIN_OPEN_RETURNS)


@dataclass(frozen=True)
class Pair:
    """The survey that holds objects, and the other one; returns closer than about ``link`` m are of one object.

    ``solid`` are the returns that may lie on a closed surface.
    """

    survey: Survey
    owner: Place
    other: Place
    link: float
    solid: Index
    appeared: bool

    def closed(self, chosen: Index, wider: float, *, flat: bool) -> list[Found]:
        """Closed surfaces about the returns ``chosen`` (n,), or flat tops, of which few returns may leave gaps."""
        link, step = wider * self.link, STEP_M / wider
        scale = 1.0 / np.array([link, link, step])
        solid = cKDTree(self._places(self.solid) * scale)
        found: list[Found] = []
        used = chosen[:0]
        for part in self._parts(chosen, link, step, _MIN_RETURNS):
            if np.isin(part, used).any():
                continue
            grown = self._grown(part, solid, scale)
            both = (part, grown) if len(grown) > len(part) else (part,)
            # most groups are vegetation, and their heights tell it at once
            some = [returns for returns in both if not flat or is_flat(self.owner.heights[returns])]
            surfaces = [one for returns in some if (one := self._one(returns, link)) is not None and one.closed]
            if surfaces:
                found.append(min(surfaces, key=lambda one: one.chance))
                used = np.union1d(used, found[-1].returns)
        return found

    def found(self, chosen: Index, step: float, least_returns: int) -> list[Found]:
        """What surely changed of the returns ``chosen`` (n,), in groups with steps of height up to ``step`` m."""
        every = (self._one(part, self.link) for part in self._parts(chosen, self.link, step, least_returns))
        return [one for one in every if one is not None]

    def _parts(self, chosen: Index, link: float, step: float, least_returns: int) -> list[Index]:
        parts = groups(self._places(chosen), np.array([link / 1.5, link / 1.5, step]))
        return [np.sort(chosen[part]) for part in parts if len(part) >= least_returns]

    def _places(self, chosen: Index) -> Float:
        return np.column_stack([self.survey.xyz[chosen, :2], self.owner.heights[chosen]])

    def _grown(self, part: Index, solid: cKDTree, scale: Float) -> Index:
        """``part`` with the ``solid`` returns next to it, for which the other survey has returns about as high."""
        near = solid.query_ball_point(self._places(part) * scale, 1.0)
        return self.solid[np.unique(np.concatenate(near).astype(np.int64))]

    def _one(self, part: Index, link: float) -> Found | None:
        xyz, height = self.survey.xyz[part], self.owner.heights[part]
        inner = core(xyz[:, :2], link)
        area = footprint(xyz[:, :2], inner, _RIM_SPACINGS * self.survey.spacing)
        tops = Tops(xyz[:, :2], height)
        hits, through = self.owner.split(area, tops)
        own, other = Counts(len(hits), len(through)), self.other.counts(area, tops)
        if likelihood_ratio(own, other) > MAX_CHANCE or own.hits * other.through <= other.hits * own.through:
            return None
        return Found(
            appeared=self.appeared,
            returns=part,
            area=area,
            shape=shape_of(xyz, height, self.owner.ground_around(area), area),
            owner=own,
            other=other,
            seen=(other.hits + other.through) * self.other.spacing**2 / area.area,
            beneath=self.owner.counts(inner, tops).through,
            ended=float(self.survey.last[hits].mean()),
            pit=pit_below(self.other, area),
        )
