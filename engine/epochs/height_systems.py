"""Whether two epochs' heights are of different systems or units, checked before their difference is used."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...interface.parameters.registration import MAX_OFFSET_M
from ..core.arrays import Float
from ..geometry.columns import greatest, least
from ..statistics.robust import nmad

FOOT_M = 0.3048
_CELL_COUNT = 900  # that the shared extent is cut into
MAX_POINTS = 400_000
"""Points of a cloud, evenly taken, that are enough for the heights of so many cells."""
_MIN_CELLS = 30  # common cells; with fewer the whole overlap is not judged
# a shift is that of all heights where so many cells are within so small a share of it
_MAX_SPREAD_RATIO, _SPREAD_QUANTILE = 0.1, 0.9
_MIN_RELIEF_M = 0.5  # m of scatter of the heights from which on a unit can be recognised
_MAX_SCATTER_RATIO = 0.1  # share of that scatter that is left where heights differ by their unit


@dataclass(frozen=True)
class HeightComparison:
    """Heights of the cells that both epochs reach.

    Attributes:
        offset: median height of the later epoch above the earlier one, metres.
        spread: nine tenths of the cells differ from it by no more, metres.
        unit_ratio: 3.281 or 0.305 where the later heights are so many times the earlier ones, as feet are; else None.
    """

    offset: float
    spread: float
    unit_ratio: float | None

    @property
    def even(self) -> bool:
        """Whether all of the overlap is shifted alike, as no deformation does."""
        return self.spread <= _MAX_SPREAD_RATIO * abs(self.offset)


def compare_clouds(reference: Float, moving: Float, *, lowest: bool = False) -> HeightComparison | None:
    """``compare_heights`` of two clouds (n, 3) and (m, 3) on coarse cells; None where they hardly overlap in plan.

    Args:
        lowest: compare the lowest points of the cells instead of the means, for clouds with plants.
    """
    if min(len(reference), len(moving)) < _MIN_CELLS:
        return None
    reference, moving = (xyz[:: max(1, len(xyz) // MAX_POINTS)] for xyz in (reference, moving))
    low = np.maximum(least(reference[:, :2]), least(moving[:, :2]))
    high = np.minimum(greatest(reference[:, :2]), greatest(moving[:, :2]))
    side = float(np.sqrt(max((high - low).prod(), 0.0) / _CELL_COUNT)) if (high > low).all() else 0.0
    if side <= 0.0:
        return None
    shape = np.ceil((high - low) / side).astype(np.int64) + 1
    if shape.prod() > 100 * _CELL_COUNT:  # a sliver
        return None
    return compare_heights(*(_cell_heights(xyz, low, high, side, shape, lowest) for xyz in (reference, moving)))


def compare_heights(first: Float, second: Float) -> HeightComparison | None:
    """Compare the heights of cells, NaN where there are none, metres; None with fewer than 30 common ones."""
    both = np.isfinite(first) & np.isfinite(second)
    if np.count_nonzero(both) < _MIN_CELLS:
        return None
    a, b = first[both], second[both]
    ratio = None
    for factor in (1 / FOOT_M, FOOT_M):
        relief = min(nmad(a), nmad(b))
        if relief > _MIN_RELIEF_M and nmad(b - factor * a) < _MAX_SCATTER_RATIO * min(nmad(b), nmad(b - a)):
            ratio = factor
    offset = float(np.median(b - a))
    return HeightComparison(offset, float(np.quantile(np.abs(b - a - offset), _SPREAD_QUANTILE)), ratio)


def disagreement(found: HeightComparison | None, first: str, second: str, limit: float) -> str | None:
    """What is wrong with the heights of the epochs named ``first`` and ``second``, and the remedy; None: nothing is.

    Args:
        limit: even offsets up to this (metres) are nothing wrong.
    """
    if found is None:
        return None
    if found.unit_ratio is not None:
        return (
            f"The heights of {second} are {found.unit_ratio:.3f} times those of {first} over the whole overlap, so one "
            "of them is in feet; convert its heights to metres, or correct the reference system that it declares."
        )
    if abs(found.offset) <= limit or not found.even:
        return None
    above = "above" if found.offset > 0 else "below"
    enough, remedy = math.ceil(abs(found.offset)) + 1, ""
    if enough <= MAX_OFFSET_M:
        remedy = f", or have the registration take it off with a maximum_offset of {enough} m"
    return (
        f"{second} lies about {abs(found.offset):.1f} m {above} {first} over the whole overlap: ellipsoidal against "
        "orthometric heights, another height system, or a shift in plan, and no deformation; bring both to the same "
        f"system{remedy}."
    )


def _cell_heights(xyz: Float, low: Float, high: Float, side: float, shape: NDArray[np.int64], lowest: bool) -> Float:
    """Mean or lowest height of each cell, NaN without a point."""
    x, y = xyz[:, :2].T
    xyz = xyz[(x >= low[0]) & (y >= low[1]) & (x <= high[0]) & (y <= high[1])]
    column, row = np.floor((xyz[:, :2] - low) / side).astype(np.int64).T
    cell = row * shape[0] + column
    number = int(shape.prod())
    if lowest:
        heights: Float = np.full(number, np.inf)
        np.minimum.at(heights, cell, xyz[:, 2])
        return np.where(np.isfinite(heights), heights, np.nan)
    count = np.bincount(cell, minlength=number)
    with np.errstate(invalid="ignore"):
        heights = np.bincount(cell, xyz[:, 2], minlength=number) / count
    return heights
