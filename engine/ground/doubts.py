"""What makes an extracted ground doubtful: what the survey lacks, or holds too much of, each with its share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from ..geometry.point_spacing import point_spacing
from .cover import percent

BARE_SHARE = 0.01
"""Share of the ground that must be bare for a survey to show how the ground looks: forests and alpine grass may have
none, slopes with 70 % plants half."""
BELOW_M, BELOW_THRESHOLDS, BELOW_SHARE = 0.2, 3.0, 0.003
"""Depth below the ground that no noise of the range reaches, in thresholds of the ground at least, and share of
returns there: 0 to 0.05 % in five real surveys, more where strays are many or ground was missed."""
LOST_SHARE = 0.05
"""Share of the pulses without their last return; in complete surveys at most 0.1 %."""
EVEN_SHARE, SQUARE_POINTS = 0.35, 4
"""Variance of the points in squares, of this many times the spacing a side, over their mean: 1 where points lie at
random, 0.8 to 7 in surveys, less than 0.3 after thinning to a point a cell."""
FEWEST_SQUARES = 30
THIN_SHARE, THIN_AREA_M2, THIN_PART = 0.05, 50.0, 0.03
"""An area is thin where squares hold less than this share of the median of points; it is reported from so many square
metres and this part of the survey on."""
LEAST_MEDIAN = 20.0
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


def ground_doubts(name: str, found: Found, lost: float) -> tuple[str, ...]:
    """Sentences on what makes the ground of the cloud ``name`` doubtful; none for a sound survey.

    Args:
        lost: share of the pulses whose last return is missing.
    """
    sentences = [_lost_returns(name, lost), _thinned(name, found.flat), _thin_area(name, found)]
    if found.height is not None and found.plant_error is not None:
        sentences += [_nothing_bare(name, found.plant_error), _below(name, found, found.height)]
    return tuple(sentence for sentence in sentences if sentence)


def _lost_returns(name: str, lost: float) -> str:
    if lost < LOST_SHARE:
        return ""
    return (
        f"The last return of {percent(lost)} of the pulses of {name} is missing, as in a cloud of first returns; under "
        "plants the ground is then missing or too high, so export the cloud with all of its returns."
    )


def _nothing_bare(name: str, error: Float) -> str:
    known = error[np.isfinite(error)]
    if not len(known):
        return ""
    bare = float(np.mean(known == 0))
    if bare >= BARE_SHARE:
        return ""
    return (
        f"Nearly nothing of the ground of {name} is bare ({percent(bare)} of the returns near it): its height is found "
        f"from below plants, with an expected error of {100 * float(np.median(known)):.1f} cm, and is too high by more "
        "where no return reached it; survey with leaves off or mown, or check it on a road or rock."
    )


def _below(name: str, found: Found, height: Float) -> str:
    known = np.isfinite(height) & found.taken
    depth = max(BELOW_M, BELOW_THRESHOLDS * found.threshold)
    deep = int(np.count_nonzero(height[known] < -depth)) + _removed_below(found, depth)
    total = int(np.count_nonzero(known)) + len(found.removed)
    share = deep / max(total, 1)
    if share < BELOW_SHARE:
        return ""
    return (
        f"{percent(share)} of the returns of {name} lie more than {depth:.1f} m below its ground: stray returns "
        "(multipath), or ground that was missed; look at them in profile, and have strays removed by the surveyor."
    )


def _removed_below(found: Found, depth: float) -> int:
    """How many of the outliers lie below the ground nearest to them."""
    if not len(found.removed) or not found.ground.any():
        return 0
    ground = found.flat[found.ground]
    nearest = cKDTree(ground[:, :2]).query(found.removed[:, :2])[1]
    return int(np.count_nonzero(found.removed[:, 2] < ground[nearest, 2] - depth))


def _thinned(name: str, flat: Float) -> str:
    counts = _counts(flat, SQUARE_POINTS * point_spacing(flat[:, :2]))
    inner = counts[ndimage.binary_erosion(counts > 0, np.ones((3, 3)))]
    if len(inner) < FEWEST_SQUARES:
        return ""
    spread = float(inner.var() / inner.mean())
    if spread >= EVEN_SHARE:
        return ""
    return (
        f"The points of {name} lie as evenly as in a cloud thinned to one point a cell (their numbers in squares vary "
        f"by {percent(spread)} of what chance makes): the ground under plants may have been thinned away; give the "
        "cloud as it was surveyed."
    )


def _thin_area(name: str, found: Found) -> str:
    """Of areas with hardly any return, those whose few points were taken for ground."""
    side = max(1.0, np.sqrt(LEAST_MEDIAN) * point_spacing(found.flat[:, :2]))
    low = found.flat[:, :2].min(axis=0)
    counts, ground = _counts(found.flat, side, low), _counts(found.flat[found.ground], side, low, found.flat)
    typical = float(np.median(counts[counts > 0]))
    thin = ndimage.binary_fill_holes(counts >= THIN_SHARE * typical) & (counts < THIN_SHARE * typical)
    label, number = ndimage.label(thin, np.ones((3, 3)))
    cells = np.bincount(label.ravel(), minlength=number + 1)
    within = np.bincount(label.ravel(), ground.ravel(), minlength=number + 1)
    doubtful = (cells * side**2 >= THIN_AREA_M2) & (within > 0)
    doubtful[0] = False
    covered = float(np.count_nonzero(counts >= THIN_SHARE * typical)) + float(cells[1:].sum())
    share = float(cells[doubtful].sum()) / covered
    if share < THIN_PART:
        return ""
    return (
        f"{percent(share)} of the area of {name} has hardly any return (water, wet or black surfaces, or shadow), and "
        f"{int(within[doubtful].sum())} scattered ones there were taken for ground; leave such areas out of the region."
    )


def _counts(points: Float, side: float, low: Float | None = None, extent: Float | None = None) -> Float:
    """Points (n, 2+) in squares; the grid begins at ``low`` and covers ``extent`` (m, 2+), by default the points'."""
    extent = points if extent is None else extent
    low = extent[:, :2].min(axis=0) if low is None else low
    shape = np.floor((extent[:, :2].max(axis=0) - low) / side).astype(np.int64) + 1
    index = np.floor((points[:, :2] - low) / side).astype(np.int64)
    found = np.bincount(index[:, 0] * shape[1] + index[:, 1], minlength=int(shape.prod()))
    return np.asarray(found, dtype=np.float64).reshape(shape)
