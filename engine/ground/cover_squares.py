"""Squares seen from above that are as small as the returns in them allow, and sums over what lies in each.

Squares of 4 m are quartered down to 0.5 m as long as they hold ``MIN_QUARTERED_RETURNS`` returns for each quarter that
holds any, so that no class rests on a handful; or where all returns lie in one half, as at the edge of a survey.
Corners are whole multiples of the side, so two surveys of one slope have the same places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float, Index

FINEST_SQUARE_M = 0.5
_LEVELS = 3
COARSEST_SQUARE_M = FINEST_SQUARE_M * 2**_LEVELS
MIN_QUARTERED_RETURNS = 8
"""Returns that a square must hold for each of its quarters that holds any, to be quartered."""
CLASS_HEIGHTS_M = (0.1, 1.0, 2.5)
"""Heights (m) over the ground above which returns are low plants, shrubs, trees."""
_HALVES = ((0, 1, 2, 3), (0, 2, 1, 3))  # quarters west and east, south and north; numbered from the south-west


@dataclass(frozen=True)
class CoverCells:
    """``index`` (n,) the square of each point; of the m squares, ``side`` (m,) metres and the south-west corner.

    ``column`` and ``row`` (m,) count steps of ``FINEST_SQUARE_M`` from the coordinates' zero. Every square has a point.
    ``area`` (m,) m² of the quarters that hold any: squares reach beyond the survey's edge.
    """

    index: Index
    side: Float
    area: Float
    column: Index
    row: Index


@dataclass(frozen=True)
class OverGround:
    """Of n points: ``ground`` which are ground, ``height`` over its surface, plants' error and height, metres.

    ``upright`` is the height square to the slope. NaN where something is not known; None where nothing is.
    """

    ground: Bool
    height: Float
    upright: Float
    plant_error: Float | None = None
    plant_height: Float | None = None


SUMS = 10 + len(CLASS_HEIGHTS_M)


def square_sums(index: Index, count: int, over: OverGround) -> Float:
    """(SUMS, count) over the points of each square, of which ``index`` (n,) is each point's.

    Returns, those of the ground, those with known heights, number and sum of known plant errors, of plant heights, then
    number, sum and sum of squares of the ground's heights and the returns above each class's height.
    """

    def number(chosen: Bool) -> Float:
        return np.bincount(index[chosen], minlength=count).astype(np.float64)

    def known_sum(values: Float | None) -> tuple[Float, Float]:
        if values is None:
            return np.zeros(count), np.zeros(count)
        known = np.isfinite(values)
        return number(known), np.bincount(index[known], values[known], count).astype(np.float64)

    known = np.isfinite(over.height)
    chosen = over.ground & known
    heights = over.height[chosen]
    rows = [
        np.bincount(index, minlength=count),
        number(over.ground),
        number(known),
        *known_sum(over.plant_error),
        *known_sum(over.plant_height),
        number(chosen),
        np.bincount(index[chosen], heights, count),
        np.bincount(index[chosen], heights**2, count),
        *(number(over.upright > limit) for limit in CLASS_HEIGHTS_M),
    ]
    return np.vstack(rows).astype(np.float64)


def cover_cells(xyz: Float) -> CoverCells:
    """Squares of points (n, 2 or 3), n > 0: of 4 m, quartered down to 0.5 m while they hold enough returns."""
    return squares_of(*finest_squares(xyz))


def finest_squares(xyz: Float) -> tuple[Index, Index]:
    """(n,) column and row of the square of ``FINEST_SQUARE_M`` that each of the points (n, 2 or 3) lies in."""
    column, row = (np.floor(xyz[:, axis] / FINEST_SQUARE_M).astype(np.int64) for axis in (0, 1))
    return column, row


def squares_of(finest_column: Index, finest_row: Index, weight: Float | None = None) -> CoverCells:
    """Squares of points of which the finest squares (n,) are known, or of such squares, with their points (n,)."""
    step = (finest_column, finest_row)
    index, column, row = _blocks(*(axis >> _LEVELS for axis in step))
    column, row = column << _LEVELS, row << _LEVELS
    size = np.full(len(column), 1 << _LEVELS)
    area = np.zeros(len(size))
    for level in range(_LEVELS - 1, -1, -1):
        quarter = 2 * ((step[0] >> level) & 1) + ((step[1] >> level) & 1)
        counts = np.bincount(4 * index + quarter, weight, 4 * len(size)).reshape(-1, 4)
        some, now = counts > 0, size == 2 << level
        held = np.count_nonzero(some, axis=1)
        both_sides = [(some[:, a] | some[:, b]) & (some[:, c] | some[:, d]) for a, b, c, d in _HALVES]
        full = ((counts.sum(axis=1) >= MIN_QUARTERED_RETURNS * held) | ~(both_sides[0] & both_sides[1])) & now
        area = np.where(now, held * (FINEST_SQUARE_M * (1 << level)) ** 2, area)
        parts = np.where(full, 4, 1)
        start = np.cumsum(parts) - parts
        index = start[index] + np.where(full[index], quarter, 0)
        which = np.arange(parts.sum()) - np.repeat(start, parts)
        area = np.repeat(area, parts)
        size = np.repeat(np.where(full, size >> 1, size), parts)
        column = np.repeat(column, parts) + (which >> 1) * size
        row = np.repeat(row, parts) + (which & 1) * size
    area[size == 1] = FINEST_SQUARE_M**2
    kept = np.bincount(index, minlength=len(size)) > 0
    return CoverCells((np.cumsum(kept) - 1)[index], FINEST_SQUARE_M * size[kept], area[kept], column[kept], row[kept])


def _blocks(column: Index, row: Index) -> tuple[Index, Index, Index]:
    """(n,) number of each point's block, and the blocks' columns and rows."""
    west, south = int(column.min()), int(row.min())
    width = int(row.max()) - south + 1
    key = (column - west) * width + (row - south)
    extent = (int(column.max()) - west + 1) * width
    if extent <= 4 * len(key) + 1_000_000:
        held = np.bincount(key, minlength=extent) > 0
        keys, index = np.flatnonzero(held), (np.cumsum(held) - 1)[key]
    else:
        # few points far apart: a full grid would not fit in memory
        keys, index = np.unique(key, return_inverse=True)
    return index, keys // width + west, keys % width + south
