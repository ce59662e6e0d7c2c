"""How the lines flown lie to those planned."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from .flown_tracks import Track

FLOWN_SHARE, PARTLY_SHARE = 0.9, 0.1
"""Shares of a line's length: from the first on it was flown, below the second it was left out."""
SEEN_SHARE = 0.6
"""As ``FLOWN_SHARE``, where the carrier's way is that of the returns: these do not show the ends of a line."""
STATES = ("flown", "partly flown", "left out")
MAX_DEVIATION_M = 2.0
"""Median deviation, in plan or height, from which a line is named."""
_STEP_M = 1.0  # between places of a track that are looked at
_PIECE_M = 2.0  # of a line, of which it is asked whether the carrier was there
_MIN_ALONG = 0.985  # cosine of the angle between a line and the way of the carrier that flies it
_MAX_ASIDE_M = 100.0  # of a single line, beyond which nothing is a flight along it
_NEAR_GROUND_M = 2.0  # in plan, within which ground counts as below
_KEPT = 95.0  # per cent of the length that the largest deviations are of


@dataclass(frozen=True)
class FlownLine:
    """A planned line as it was flown.

    ``share`` of its length was flown; ``state`` is one of ``STATES``. Deviations in metres, NaN where none of it was:
    ``aside`` the median in plan, positive to the right of the planned direction, ``aside_most`` what 95 % of its length
    keep to; ``above`` the median over the planned height, ``above_most`` likewise; ``over_ground`` the median height
    over the ground below, NaN where no ground is known.
    """

    number: int
    share: float
    state: str
    aside: float
    aside_most: float
    above: float
    above_most: float
    over_ground: float

    @property
    def deviates(self) -> bool:
        """Whether it was flown elsewhere than planned by more than 2 m at the median."""
        return self.share >= PARTLY_SHARE and max(abs(self.aside), abs(self.above)) > MAX_DEVIATION_M


@dataclass(frozen=True)
class _Beneath:
    """Places of the carrier as seen from one line: metres ``at`` along it, ``aside`` to its right and ``above`` it, and
    whether the carrier goes ``along`` there, to or fro; all (n,).
    """

    at: Float
    aside: Float
    above: Float
    along: Bool


def flown_lines(planned: list[Float], tracks: list[Track], ground: Float | None, flown_from: float) -> list[FlownLine]:
    """Compare each planned line (k, 3) with the tracks.

    A place of a track belongs to the line that is nearest in plan of those along which the carrier moves there, to or
    fro, and that is no farther than half the way to the next line.

    Args:
        ground: (m, 3) places of the ground, metres; None where it is not known.
        flown_from: share of a line from which on it was flown.
    """
    stretches = [_dense(track.xyz) for track in tracks]
    xyz = np.concatenate([np.empty((0, 3)), *(places for places, _ in stretches)])
    way = np.concatenate([np.empty((0, 2)), *(ways for _, ways in stretches)])
    placed = [_beneath(line, xyz, way) for line in planned]
    distance = np.array([np.where(one.along, np.abs(one.aside), np.inf) for one in placed])
    nearest = np.argmin(distance, axis=0)
    over = _over_ground(xyz, ground)
    found = []
    for index, (line, seen) in enumerate(zip(planned, placed, strict=True)):
        own = (nearest == index) & (distance[index] <= _half_way(index, planned))
        pieces = np.histogram(seen.at[own], bins=max(1, math.floor(_length(line) / _PIECE_M)), range=(0, _length(line)))
        share = float((pieces[0] > 0).mean())
        state = STATES[0] if share >= flown_from else STATES[1] if share >= PARTLY_SHARE else STATES[2]
        found.append(
            FlownLine(
                index + 1,
                share,
                state,
                _median(seen.aside[own]),
                _most(seen.aside[own]),
                _median(seen.above[own]),
                _most(seen.above[own]),
                _median(over[own]),
            )
        )
    return found


def _dense(xyz: Float) -> tuple[Float, Float]:
    """Places (m, 3) at most a metre apart along a track (n, 3), and unit vectors of the carrier's way there in plan."""
    steps = np.diff(xyz, axis=0)
    length = np.hypot(steps[:, 0], steps[:, 1])
    moved = np.flatnonzero(length > 1e-9)
    count = np.maximum(1, np.ceil(length[moved] / _STEP_M)).astype(np.int64)
    part = np.repeat(moved, count)
    first = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(len(part)) - first + 0.5) / np.repeat(count, count)
    return xyz[part] + share[:, None] * steps[part], steps[part, :2] / length[part, None]


def _beneath(line: Float, xyz: Float, way: Float) -> _Beneath:
    corners = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    shape = shapely.LineString(line[:, :2])
    at = shapely.line_locate_point(shape, shapely.points(xyz[:, :2]))
    leg = np.clip(np.searchsorted(corners, at, side="right") - 1, 0, len(line) - 2)
    direction = np.diff(line[:, :2], axis=0)
    direction = (direction / np.maximum(np.hypot(*direction.T), 1e-12)[:, None])[leg]
    aside = xyz[:, :2] - line[leg, :2]
    right = aside[:, 0] * direction[:, 1] - aside[:, 1] * direction[:, 0]
    ahead = (aside * direction).sum(axis=1) - (at - corners[leg])
    along = (np.abs((way * direction).sum(axis=1)) >= _MIN_ALONG) & (np.abs(ahead) <= _STEP_M)
    return _Beneath(at, right, xyz[:, 2] - np.interp(at, corners, line[:, 2]), along)


def _length(line: Float) -> float:
    return float(np.hypot(*np.diff(line[:, :2], axis=0).T).sum())


def _half_way(index: int, planned: list[Float]) -> float:
    own = shapely.LineString(planned[index][:, :2])
    others = [shapely.distance(own, shapely.LineString(p[:, :2])) for n, p in enumerate(planned) if n != index]
    return min([_MAX_ASIDE_M, *(max(distance / 2, 0.5) for distance in others)])


def _over_ground(xyz: Float, ground: Float | None) -> Float:
    if ground is None or not len(ground) or not len(xyz):
        return np.full(len(xyz), np.nan)
    distance, nearest = cKDTree(ground[:, :2]).query(xyz[:, :2])
    return np.asarray(np.where(distance <= _NEAR_GROUND_M, xyz[:, 2] - ground[nearest, 2], np.nan))


def _median(values: Float) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _most(values: Float) -> float:
    return float(np.percentile(np.abs(values), _KEPT)) if values.size else float("nan")
