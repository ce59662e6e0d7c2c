"""How far the errors that clouds state for their plants hold between two surveys, and how much of them the whole slope
has in common, measured on stable ground.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..statistics.layout import Layout, layout_of
from ..statistics.normal import quantile
from ..statistics.quantiles import sample_quantile

PATCH_M = 2.0
"""Side of the squares that count as one sample each, m: plants' errors are alike over about this distance."""
MIN_PATCHES = 20


def plants_factor(
    dz: Float,
    sampling: Float,
    plants: Float,
    stable: NDArray[np.bool_],
    square: NDArray[np.signedinteger[Any]],
    *,
    registration_error: float,
    confidence: float,
) -> float:
    """Factor, 0 to 1, of the error by plants with which 1 - ``confidence`` of stable cells under plants are beyond.

    Each epoch's cloud states its error against the true ground, of which two surveys of one season have much in common:
    the same grass on the same ground lifts both alike. Where the season differs nothing cancels. Which it is shows on
    stable ground: as in ``slope_calibration.calibrate`` the factor is taken from the quantile that the level is about,
    here of the cells whose error is plants' more than points'. It does not widen: that all grass lies lower after
    mowing is known from the plants' heights (``season``), and ground that moved by little would hide itself.

    Cells of one square of 2 m share much of their error. With fewer than 20 such squares the factor is 1. The quantile
    is one standard error of its share higher, which follows from how the share differs between the squares (ratio
    to size in a cluster sample; Cochran, Sampling Techniques, 1977, chapter 9A).

    Args:
        dz, sampling, plants: change, its standard error by points (calibrated) and that by plants, metres, arrays of
            one shape; NaN where not compared.
        stable: what is taken as stable; one cell of each grown cell.
        square: number of the square of 2 m that each is in (``squares_of`` for the cells of a grid).
        registration_error: metres.
    """
    with np.errstate(invalid="ignore"):
        under_plants = stable & np.isfinite(dz) & (plants > sampling)
    patches, patch = np.unique(square[under_plants], return_inverse=True)
    if len(patches) < MIN_PATCHES:
        return 1.0
    needed = (
        (dz[under_plants] / quantile(confidence)) ** 2 - sampling[under_plants] ** 2 - registration_error**2
    ) / plants[under_plants] ** 2
    beyond = needed > sample_quantile(needed, confidence)
    surplus = np.bincount(patch, beyond - beyond.mean())
    surer = min(confidence + float(np.linalg.norm(surplus)) / len(needed), 1.0)
    return min(math.sqrt(max(sample_quantile(needed, surer), 0.0)), 1.0)


def squares_of(layout: Layout, cell: float) -> NDArray[np.int64]:
    """Number of the square of ``PATCH_M`` that each cell of a grid is in, in its layout; ``cell`` metres a side."""
    width = max(round(PATCH_M / cell), 1)
    across = (layout.shape[1] - 1) // width + 1
    if layout.listed is None:
        row, column = (np.arange(n, dtype=np.int64) // width for n in layout.shape)
        return row[:, None] * across + column
    row, column = np.divmod(layout.listed, layout.shape[1])
    return row // width * across + column // width


def common_share(
    dz: Float,
    sampling: Float,
    plants: Float,
    stable: NDArray[np.bool_],
    cell: float,
    layout: Layout | None = None,
) -> float:
    """Share (0 to 1) of the error by plants that is the same all over the slope.

    A season lifts or lowers all of it alike; what stands in one place and not in another does not. On stable ground
    under plants the mean of the change over its error by plants is what all have in common, and the scatter of the
    means of squares of 2 m how well that is known. The share is both together: the root of the mean's square and of its
    standard error's. With fewer than 20 squares all of the error counts as common (1).

    Args:
        dz, sampling, plants: as in ``plants_factor``, ``plants`` after that factor.
        stable: cells of stable ground, one of each grown cell.
        cell: side of a cell, metres.
        layout: of the arrays; all cells (rows, columns) by default.
    """
    with np.errstate(invalid="ignore"):
        under_plants = stable & np.isfinite(dz) & (plants > sampling)
    layout = layout or layout_of(dz)
    _, patch = np.unique(squares_of(layout, cell)[under_plants], return_inverse=True)
    count = np.bincount(patch)
    if len(count) < MIN_PATCHES:
        return 1.0
    means = np.bincount(patch, dz[under_plants] / plants[under_plants]) / count
    return min(math.hypot(float(means.mean()), float(means.std(ddof=1)) / math.sqrt(len(means))), 1.0)


def sum_by_plants(weighted: Float, cell: float, share: float, layout: Layout | None = None) -> float:
    """Standard error of a sum of changes, by plants, of whose error a ``share`` is common to all.

    All of it is alike within squares of 2 m, whose errors are independent except for the share.

    Args:
        weighted: each cell's weight times its error by plants (rows, columns), not negative; of cells that are one,
            their sum in one of them.
        cell: side of a cell, metres.
        layout: of the weights; all cells (rows, columns) by default.
    """
    sums = np.bincount(squares_of(layout or layout_of(weighted), cell).ravel(), weighted.ravel())
    return min(math.hypot(share * float(sums.sum()), float(np.sqrt(np.sum(sums**2)))), float(sums.sum()))
