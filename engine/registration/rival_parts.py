"""Which of two parts of a surface that agree on different motions stayed, and when that is undecidable.

No geometry distinguishes a block that moved as one from ground that stayed. Evidence for a part: it is much larger than
any other, lies around the other as ground does around a landslide, and lies where it was surveyed. Evidence against
it: the other one then rose, and slopes sink and slide down. None of that is proof. Parts of similar weight are refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from ..core.arrays import Float
from .observability import height_sd
from .patch_agreement import MIN_ERROR_M
from .stable_patches import StablePart

MAX_RIVAL_RATIO_BESIDE = 0.55
"""Of the part: so much may another one hold beside it."""
_MAX_COMPACTNESS_RATIO = 0.7  # of the other's compactness
_MIN_RISE_SDS = 2.0  # standard errors of the height between both parts
# Two surveys of 4 cm in height and 6.5 cm in plan each differ by less than 0.25 m in 95 % of pairs.
_AS_SURVEYED, _ASTRAY = (0.0, 0.25), (0.5, np.inf)  # metres


class Verdict(Enum):
    """Which of two parts stayed; by position: because it lies where it was surveyed; NEITHER: too small a part."""

    PART = auto()
    PART_BY_POSITION = auto()
    OTHER_BY_POSITION = auto()
    NEITHER = auto()
    UNDECIDED = auto()


class Evidence(NamedTuple):
    """Shares of the surface, offsets in metres, and how the other part ``lies``: around, within or beside the part.

    ``rose``: the other part lies higher than before if the part stayed.
    """

    share: float
    other_share: float
    lies: str = "beside"
    rose: bool = False
    offset: float = 0.1
    other_offset: float = 0.1


class _Row(NamedTuple):
    """A verdict where all hold: from the first number to below the second; the ``ratio`` is of both shares."""

    verdict: Verdict
    share: tuple[float, float] = (0.0, np.inf)
    other_share: tuple[float, float] = (0.0, np.inf)
    ratio: tuple[float, float] = (0.0, np.inf)
    lies: tuple[str, ...] = ("around", "within", "beside")
    rose: tuple[bool, ...] = (False, True)
    offset: tuple[float, float] = (0.0, np.inf)
    other_offset: tuple[float, float] = (0.0, np.inf)

    def holds(self, seen: Evidence) -> bool:
        ratio = seen.other_share / max(seen.share, 1e-9)
        within = zip(
            (self.share, self.other_share, self.ratio, self.offset, self.other_offset),
            (seen.share, seen.other_share, ratio, seen.offset, seen.other_offset),
            strict=True,
        )
        inside = all(low <= value < high for (low, high), value in within)
        return inside and seen.lies in self.lies and seen.rose in self.rose


_NOT_AROUND = ("within", "beside")
# The first row that holds. By chance 10 % agree outside of a part.
_TABLE = (
    _Row(Verdict.NEITHER, share=(0.0, 0.2)),
    _Row(Verdict.PART, other_share=(0.0, 0.1)),
    # a datum that is off by chance as far as a block moved back is less likely than a block that moved
    _Row(Verdict.OTHER_BY_POSITION, other_share=(0.2, 1), ratio=(0.7, 1), offset=_ASTRAY, other_offset=_AS_SURVEYED),
    _Row(Verdict.UNDECIDED, offset=_ASTRAY, other_offset=_AS_SURVEYED),
    # slopes sink and slide down; less than a fifth is rather a fill than what stayed
    _Row(Verdict.PART_BY_POSITION, ratio=(0.2, np.inf), rose=(True,), offset=_AS_SURVEYED, other_offset=_ASTRAY),
    _Row(Verdict.UNDECIDED, ratio=(0.2, np.inf), rose=(True,)),
    # a block that moved is compact, and ground that stayed lies around it
    _Row(Verdict.PART, ratio=(0.0, 0.2), lies=("around",)),
    # a block that moved may be larger than what stayed
    _Row(Verdict.PART, share=(0.0, 0.4), ratio=(0.0, 0.4), lies=_NOT_AROUND),
    _Row(Verdict.PART, share=(0.4, np.inf), ratio=(0.0, MAX_RIVAL_RATIO_BESIDE), lies=_NOT_AROUND),
    _Row(Verdict.PART, share=(0.5, np.inf), ratio=(0.0, 0.7), lies=("within",)),
    _Row(Verdict.PART_BY_POSITION, offset=_AS_SURVEYED, other_offset=_ASTRAY),
    _Row(Verdict.UNDECIDED),
)


def verdict(seen: Evidence) -> Verdict:
    return next(row.verdict for row in _TABLE if row.holds(seen))


@dataclass(frozen=True)
class Standing:
    """The ``part`` to be taken as stable.

    Attributes:
        known: whether it is clearly the one that did not move.
        contested: another part contradicts it as strongly.
        by_position: it was chosen only because it lies where it was surveyed.
        offset, other_offset: how far the part and the other one lie from where they were surveyed, metres.
        apart: how far apart the motions of both take the surface (root mean square), metres.
        rose: the other part lies higher than before if the part stayed.
    """

    part: StablePart
    known: bool
    contested: bool = False
    by_position: bool = False
    offset: float = 0.0
    other_offset: float = 0.0
    apart: float = 0.0
    rose: bool = False


def standing(part: StablePart, radius: float) -> Standing:
    """Judge the largest part and the largest other one.

    Args:
        radius: by which rotations are scaled in the parts' information, metres.
    """
    other, offset = part.other, _offset(part)
    if other is None:
        return Standing(part, verdict(Evidence(part.share, 0.0, offset=offset)) is Verdict.PART, offset=offset)
    other_offset = _offset(other)
    lies = "beside"
    if _surrounds(other, part) and _in_the_middle(part, other):
        lies = "around"
    elif _surrounds(part, other):
        lies = "within"
    rose = _rose(part, other, radius)
    found = verdict(Evidence(part.share, other.share, lies, rose, offset, other_offset))
    judged = Standing(
        part,
        found not in (Verdict.NEITHER, Verdict.UNDECIDED),
        found is Verdict.UNDECIDED,
        found in (Verdict.PART_BY_POSITION, Verdict.OTHER_BY_POSITION),
        offset,
        other_offset,
        _apart(part, other, part.patches.centre),
        rose,
    )
    if found is Verdict.OTHER_BY_POSITION:
        swapped = replace(other, other=replace(part, other=None))
        return replace(judged, part=swapped, offset=other_offset, other_offset=offset)
    return judged


def _rose(part: StablePart, other: StablePart, radius: float) -> bool:
    """Whether the other part rose by more than both errors, if the part stayed."""
    centre, area = other.patches.centre[other.agrees], other.patches.area[other.agrees]
    if not len(centre):
        return False
    up = np.tile([0.0, 0.0, 1.0], (len(centre), 1))
    errors = [height_sd(one.information.covariance, centre, up, radius) for one in (part, other)]
    rise = np.average((part.pose.apply(centre) - other.pose.apply(centre))[:, 2], weights=area)
    return bool(rise > _MIN_RISE_SDS * np.linalg.norm([*errors, MIN_ERROR_M]))


def _offset(part: StablePart) -> float:
    """Root mean square displacement of a part's own patches from where they were surveyed, metres."""
    centre = part.patches.centre[part.agrees]
    return float(np.sqrt(np.mean(np.sum((part.pose.apply(centre) - centre) ** 2, axis=1)))) if len(centre) else 0.0


def _apart(part: StablePart, other: StablePart, places: Float) -> float:
    away = part.pose.apply(places) - other.pose.apply(places)
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))


def _surrounds(part: StablePart, other: StablePart) -> bool:
    """Whether a part is spread over the surface and the other one compact, as a block that moved is."""
    return _compactness(part) < _MAX_COMPACTNESS_RATIO * _compactness(other)


def _in_the_middle(part: StablePart, other: StablePart) -> bool:
    """Whether the other part's middle lies within a part, which a strip beside it does not."""
    if not (part.agrees.any() and other.agrees.any()):
        return False
    one, two = (np.average(p.patches.centre[p.agrees], axis=0, weights=p.patches.area[p.agrees]) for p in (part, other))
    centre, area = part.patches.centre[part.agrees], part.patches.area[part.agrees]
    spread = np.average(np.sum((centre - one) ** 2, axis=1), weights=area)
    return bool(np.sum((two - one) ** 2) < spread)


def _compactness(part: StablePart) -> float:
    """A part's area by that of the disc as widely spread: 1 for a disc, less for what lies around something."""
    centre, area = part.patches.centre[part.agrees], part.patches.area[part.agrees]
    if not len(area):
        return 0.0
    away = np.sum((centre - np.average(centre, axis=0, weights=area)) ** 2, axis=1)
    return float(area.sum() / max(2 * np.pi * float(np.average(away, weights=area)), 1e-9))


def difference(found: Standing, radius: float) -> Float:
    """(6,) the motion (rotations times ``radius``) from the part's pose to the other's; zero without one."""
    other = found.part.other
    return np.zeros(6) if other is None else other.pose.vector(radius) - found.part.pose.vector(radius)


def refusal(found: Standing) -> str:
    """The sentence that refuses surveys of which two parts contradict each other."""
    part, other = found.part, found.part.other
    assert other is not None
    if found.rose and other.share <= MAX_RIVAL_RATIO_BESIDE * part.share:
        return (
            f"{part.share:.0%} of the surface agrees on one motion, but another {other.share:.0%} then rose against it "
            f"(the motions are {found.apart:.2f} m apart), which slopes hardly do: the first part may have sunk; give "
            "an area known to be stable (--stable), or --accept-unstable to go on with an error that covers both."
        )
    return (
        f"No part of the surface is clearly the one that did not move: {part.share:.0%} of it agrees on one motion "
        f"({found.offset:.2f} m from where it was surveyed) and {other.share:.0%} on another ({found.other_offset:.2f} "
        f"m), which lie {found.apart:.2f} m apart; give an area known to be stable (--stable), or --accept-unstable "
        "to go on with an error that covers both."
    )


def caution(found: Standing, error: float) -> str:
    """The sentence about a part that was taken though another one is about as large; ``error`` (m) of a height."""
    part = found.part
    parts = (
        f"{part.share:.0%} of the surface agrees on one motion ({found.offset:.2f} m from where it was surveyed) and "
        f"{part.rival:.0%} on another ({found.other_offset:.2f} m)"
    )
    if found.contested:
        return (
            f"It is undecidable which part of the surface stayed: {parts}; the registration error is widened to "
            f"{error:.3f} m, which covers both; give an area known to be stable."
        )
    return (
        f"{parts}: the first is taken as stable because it lies where it was surveyed; give an area known to be stable "
        "if the surveys' positions may be off by as much as the other's."
    )
