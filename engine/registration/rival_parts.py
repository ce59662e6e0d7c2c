"""Which of two parts of a surface that agree on different motions stayed, and when that is undecidable.

No geometry distinguishes a block that moved as one from ground that stayed. Evidence for a part: that it is much larger
than any other, that it lies around the other as ground does around a landslide, and that it lies where it was
surveyed. None of that is proof, so two parts of similar weight are refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Float
from .stable_patches import StablePart

_MIN_RIVAL_SHARE = 0.10  # of the patches' area: by chance as much agrees outside of a part
_MIN_PART_SHARE = 0.20  # twice that
_MIN_MAJORITY_SHARE = 0.5
# of the part, that the other one may hold. A block that moved is compact, and ground that stayed lies around it.
_MAX_RIVAL_RATIO = 0.7  # a majority lies around the other part
MAX_RIVAL_RATIO_BESIDE = 0.55  # neither lies around the other, or a part of less than half of the surface does
_MAX_RIVAL_RATIO_AROUND = 0.2  # the other one lies around the part
# a smaller part: a block that moved may be larger than what stayed
_MAX_SMALL_PART_SHARE, _MAX_RIVAL_RATIO_OF_SMALL_PART = 0.4, 0.4
_MAX_COMPACTNESS_RATIO = 0.7  # of the other's compactness
# Two surveys of 4 cm in height and 6.5 cm in plan each differ by less than 0.25 m in 95 % of pairs.
_MAX_OFFSET_AS_SURVEYED_M, _MIN_OFFSET_ASTRAY_M = 0.25, 0.5  # metres


@dataclass(frozen=True)
class Standing:
    """The ``part`` to be taken as stable.

    Attributes:
        known: whether it is clearly the one that did not move.
        contested: another part contradicts it as strongly.
        by_position: it was chosen only because it lies where it was surveyed.
        offset, other_offset: how far the part and the other one lie from where they were surveyed, metres.
        apart: how far apart the motions of both take the surface (root mean square), metres.
    """

    part: StablePart
    known: bool
    contested: bool = False
    by_position: bool = False
    offset: float = 0.0
    other_offset: float = 0.0
    apart: float = 0.0


def standing(part: StablePart) -> Standing:
    """Judge the largest part and the largest other one."""
    if part.share < _MIN_PART_SHARE:
        return Standing(part, known=False)
    other = part.other
    if other is None:
        return Standing(part, known=True, offset=_offset(part))
    ratio = other.share / max(part.share, 1e-9)
    offset, other_offset = (_offset(one) for one in (part, other))
    found = Standing(
        part, known=True, offset=offset, other_offset=other_offset, apart=_apart(part, other, part.patches.centre)
    )
    large = other.share >= _MIN_RIVAL_SHARE
    # a datum that is off by chance as far as a block moved back is less likely than a block that moved
    doubted = large and offset > _MIN_OFFSET_ASTRAY_M and other_offset < _MAX_OFFSET_AS_SURVEYED_M
    most = _most(part, other)
    if not doubted and (ratio <= most or (not large and ratio <= MAX_RIVAL_RATIO_BESIDE)):
        return found
    if not large:
        return replace(found, known=False)
    if offset < _MAX_OFFSET_AS_SURVEYED_M and other_offset > _MIN_OFFSET_ASTRAY_M:
        return replace(found, by_position=True)
    if ratio > _MAX_RIVAL_RATIO and doubted and other.share >= _MIN_PART_SHARE:
        swapped = replace(other, other=replace(part, other=None))
        return replace(found, part=swapped, by_position=True, offset=other_offset, other_offset=offset)
    return replace(found, known=False, contested=True)


def _most(part: StablePart, other: StablePart) -> float:
    """The ratio of both shares above which the other part contradicts a part."""
    most = (
        _MAX_RIVAL_RATIO_AROUND
        if _surrounds(other, part) and _in_the_middle(part, other)
        else _MAX_RIVAL_RATIO
        if part.share >= _MIN_MAJORITY_SHARE and _surrounds(part, other)
        else MAX_RIVAL_RATIO_BESIDE
    )
    return min(most, _MAX_RIVAL_RATIO_OF_SMALL_PART) if part.share < _MAX_SMALL_PART_SHARE else most


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
