"""What makes an extracted ground doubtful: what the survey lacks, or holds too much of, each with its share."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from ..geometry.columns import greatest, least
from ..geometry.point_spacing import point_spacing
from .cover import percent

MIN_BARE_SHARE = 0.01
"""Share of the ground that must be bare for a survey to show how the ground looks: forests and alpine grass may have
none, slopes with 70 % plants half."""
BELOW_M, BELOW_THRESHOLDS, MAX_BELOW_SHARE = 0.2, 3.0, 0.003
"""Depth below the ground that no noise of the range reaches, in thresholds of the ground at least, and share of
returns there: 0 to 0.05 % in five real surveys, more where strays are many or ground was missed."""
MAX_LOST_SHARE = 0.05
"""Share of the pulses without their last return; in complete surveys at most 0.1 %."""
MAX_EVEN_VARIANCE_RATIO, SQUARE_POINTS = 0.35, 4
"""Variance of the points in squares, of this many times the spacing a side, over their mean: 1 where points lie at
random, 0.8 to 7 in surveys, less than 0.3 after thinning to a point a cell."""
MIN_SQUARES = 30
THIN_SHARE, THIN_AREA_M2, THIN_PART = 0.05, 50.0, 0.03
"""An area is thin where squares hold less than this share of the median of points; it is reported from so many square
metres and this part of the survey on."""
MIN_MEDIAN_POINTS = 20.0
"""Points in the median square of the squares with which thin areas are looked for."""


@dataclass(frozen=True)
class Found:
    """An extracted ground, arrays of n points in a frame in which the slope lies flat, metres.

    ``taken`` are the points that took part, ``height`` is over the ground's surface (NaN: not known), ``plant_error``
    the standard error of the ground by plants (0: bare, NaN: not known), ``threshold`` the largest distance of ground
    from its surface; ``removed`` (m, 3) outliers left out before.
    """

    flat: Float
    ground: Bool
    taken: Bool
    height: Float | None
    plant_error: Float | None
    removed: Float
    threshold: float


@dataclass(frozen=True)
class DoubtFacts:
    """What is looked at. Shares are 0 to 1; NaN where it was not looked for or nothing can be said.

    ``lost`` of the pulses are without their last return. ``evenness`` is the variance of the points' numbers in squares
    over their mean. ``thin_share`` of the area has hardly any return, with ``thin_ground`` returns taken for ground.
    ``bare_share`` of the known ground is bare, ``error`` (m) is its median plant error. ``deep_share`` of the returns
    lie more than ``depth`` m below the ground.
    """

    lost: float
    evenness: float = math.nan
    thin_share: float = 0.0
    thin_ground: int = 0
    bare_share: float = math.nan
    error: float = math.nan
    deep_share: float = math.nan
    depth: float = math.nan


def ground_doubts(name: str, found: Found, lost: float) -> tuple[str, ...]:
    """Sentences on what makes the ground of the cloud ``name`` doubtful; none for a sound survey.

    Args:
        lost: share of the pulses whose last return is missing.
    """
    spacing = point_spacing(found.flat[:, :2])
    counts = square_counts(found.flat, SQUARE_POINTS * spacing)
    facts = DoubtFacts(lost, evenness(*even_sums(counts)), *_thin_area(found, spacing))
    if found.height is not None and found.plant_error is not None:
        error = found.plant_error[np.isfinite(found.plant_error)]
        bare = (float(np.mean(error == 0)), float(np.median(error))) if len(error) else (math.nan, math.nan)
        deep, depth = _below(found, found.height)
        facts = replace(facts, bare_share=bare[0], error=bare[1], deep_share=deep, depth=depth)
    return doubt_sentences(name, facts)


def doubt_sentences(name: str, facts: DoubtFacts) -> tuple[str, ...]:
    """What is doubtful of the cloud ``name`` in words, the same for a cloud in one piece and in tiles."""
    sentences = (
        _lost_returns(name, facts),
        _thinned(name, facts),
        _thin_areas(name, facts),
        _nothing_bare(name, facts),
        _deep(name, facts),
    )
    return tuple(sentence for sentence in sentences if sentence)


def _lost_returns(name: str, facts: DoubtFacts) -> str:
    if facts.lost < MAX_LOST_SHARE:
        return ""
    return (
        f"The last return of {percent(facts.lost)} of the pulses of {name} is missing, as in a cloud of first returns; "
        "under plants the ground is then missing or too high, so export the cloud with all of its returns."
    )


def _nothing_bare(name: str, facts: DoubtFacts) -> str:
    if not facts.bare_share < MIN_BARE_SHARE:
        return ""
    return (
        f"Nearly nothing of the ground of {name} is bare ({percent(facts.bare_share)} of the returns near it): its "
        f"height is found from below plants, with an expected error of {100 * facts.error:.1f} cm, and is too high by "
        "more where no return reached it; survey with leaves off or mown, or check it on a road or rock."
    )


def _deep(name: str, facts: DoubtFacts) -> str:
    if not facts.deep_share >= MAX_BELOW_SHARE:
        return ""
    return (
        f"{percent(facts.deep_share)} of the returns of {name} lie more than {facts.depth:.1f} m below its ground: "
        "stray returns (multipath), or ground that was missed; look at them in profile, and have strays removed by the "
        "surveyor."
    )


def _thinned(name: str, facts: DoubtFacts) -> str:
    if not facts.evenness < MAX_EVEN_VARIANCE_RATIO:
        return ""
    return (
        f"The points of {name} lie as evenly as in a cloud thinned to one point a cell (their numbers in squares vary "
        f"by {percent(facts.evenness)} of what chance makes): the ground under plants may have been thinned away; give "
        "the cloud as it was surveyed."
    )


def _thin_areas(name: str, facts: DoubtFacts) -> str:
    if facts.thin_share < THIN_PART:
        return ""
    return (
        f"{percent(facts.thin_share)} of the area of {name} has hardly any return (water, wet or black surfaces, or "
        f"shadow), and {facts.thin_ground} scattered ones there were taken for ground; leave such areas out of the "
        "region."
    )


def depth_below(threshold: float) -> float:
    """Depth (m) below the ground that no noise of the range reaches, for the ground's ``threshold`` m."""
    return max(BELOW_M, BELOW_THRESHOLDS * threshold)


def _below(found: Found, height: Float) -> tuple[float, float]:
    known = np.isfinite(height) & found.taken
    depth = depth_below(found.threshold)
    ground = found.flat[found.ground]
    deep = int(np.count_nonzero(height[known] < -depth)) + removed_below(found.removed, ground, depth)
    total = int(np.count_nonzero(known)) + len(found.removed)
    return deep / max(total, 1), depth


def removed_below(removed: Float, ground: Float, depth: float) -> int:
    """How many outliers (m, 3) lie more than ``depth`` m below the nearest ground (n, 3)."""
    if not len(removed) or not len(ground):
        return 0
    nearest = cKDTree(ground[:, :2]).query(removed[:, :2])[1]
    return int(np.count_nonzero(removed[:, 2] < ground[nearest, 2] - depth))


def even_sums(counts: Float, counted: Bool | None = None) -> tuple[int, float, float]:
    """Number of squares with points all around, and sums of their points and of these numbers squared.

    Args:
        counts: (rows, columns) points in squares, see ``square_counts``.
        counted: (rows, columns) which squares to count; all by default.
    """
    chosen = ndimage.binary_erosion(counts > 0, np.ones((3, 3)))
    inner = counts[chosen if counted is None else chosen & counted]
    return len(inner), float(inner.sum()), float((inner**2).sum())


def evenness(number: int, total: float, squares: float) -> float:
    """Variance over mean of the points in squares, from sums as of ``even_sums``; NaN for too few squares."""
    if number < MIN_SQUARES:
        return math.nan
    mean = total / number
    return (squares / number - mean**2) / mean


def thin_side(spacing: float) -> float:
    """Side (m) of the squares with which thin areas are looked for, of a cloud whose points are ``spacing`` m apart."""
    return max(1.0, math.sqrt(MIN_MEDIAN_POINTS) * spacing)


def _thin_area(found: Found, spacing: float) -> tuple[float, int]:
    side = thin_side(spacing)
    low = least(found.flat[:, :2])
    counts, ground = (
        square_counts(found.flat, side, low),
        square_counts(found.flat[found.ground], side, low, found.flat),
    )
    return thin_area(counts, ground, side)


def thin_area(counts: Float, ground: Float, side: float) -> tuple[float, int]:
    """Share of the area with hardly any return whose few points were taken for ground, and the number of these.

    Args:
        counts, ground: (rows, columns) all points and those of the ground in squares of ``side`` m.
    """
    typical = float(np.median(counts[counts > 0]))
    thin = ndimage.binary_fill_holes(counts >= THIN_SHARE * typical) & (counts < THIN_SHARE * typical)
    label, number = ndimage.label(thin, np.ones((3, 3)))
    cells = np.bincount(label.ravel(), minlength=number + 1)
    within = np.bincount(label.ravel(), ground.ravel(), minlength=number + 1)
    doubtful = (cells * side**2 >= THIN_AREA_M2) & (within > 0)
    doubtful[0] = False
    covered = float(np.count_nonzero(counts >= THIN_SHARE * typical)) + float(cells[1:].sum())
    return float(cells[doubtful].sum()) / covered, int(within[doubtful].sum())


def square_counts(points: Float, side: float, low: Float | None = None, extent: Float | None = None) -> Float:
    """(rows, columns) points (n, 2+) in squares of ``side`` m.

    The grid begins at ``low`` and covers ``extent`` (m, 2+), by default the points'.
    """
    extent = points if extent is None else extent
    low = least(extent[:, :2]) if low is None else low
    shape = np.floor((greatest(extent[:, :2]) - low) / side).astype(np.int64) + 1
    column, row = (np.floor((points[:, axis] - low[axis]) / side).astype(np.int64) for axis in (0, 1))
    found = np.bincount(column * shape[1] + row, minlength=int(shape.prod()))
    return np.asarray(found, dtype=np.float64).reshape(shape)
