"""Shares of significant ground by class of slope, and level of detection learned on one half of a slope."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
import shapely

from ...engine.change.result import Change
from ...engine.core.arrays import Bool, Float

LIMITS = (0.0, 15.0, 30.0, 45.0, 90.0)
"""Limits of the classes, degrees."""
TARGET = "3 to 7 % in every class of slope"
_MIN_COUNT = 200  # the share beyond is then known to 1.5 %


def shares_by_slope(slope: Float, significant: Bool, limits: Sequence[float] = LIMITS) -> dict[str, float]:
    """Share of ``significant`` (n,) by class of ``slope`` (n,), degrees; classes with few values are left out."""
    shares = {}
    for low, high in pairwise(limits):
        inside = (slope >= low) & (slope < high)
        if np.count_nonzero(inside) >= _MIN_COUNT:
            shares[f"{low:g}-{high:g}°"] = float(significant[inside].mean())
    return shares


def cell_shares(changes: Iterable[tuple[Change, Bool]], limits: Sequence[float] = LIMITS) -> dict[str, float]:
    """The same of the cells of changes, each with where (rows, columns) they count; a grown cell is one of them."""
    slopes, beyond = [], []
    for change, where in changes:
        counted = change.partition.middles(where)
        slopes.append(change.slope[counted])
        beyond.append(change.significant[counted])
    return shares_by_slope(np.concatenate(slopes), np.concatenate(beyond), limits)


def halves(xyz: Float, margin: float = 0.0) -> list[tuple[shapely.Polygon, float, bool]]:
    """The western and the eastern half around points (n, 3), ``margin`` m wider: area, limit in x, whether western."""
    west, south = xyz[:, :2].min(axis=0) - margin
    east, north = xyz[:, :2].max(axis=0) + margin
    middle = float(np.median(xyz[:, 0]))
    return [
        (shapely.box(west, south, middle, north), middle, True),
        (shapely.box(middle, south, east, north), middle, False),
    ]


def beyond_half(change: Change, middle: float, western: bool) -> Bool:
    """Measured cells (rows, columns) east of ``middle`` where the level was learned west of it, else west of it."""
    x = change.grid.west + (np.arange(change.grid.columns) + 0.5) * change.grid.cell
    return change.valid & (x > middle if western else x < middle)


def text(shares: dict[str, float]) -> str:
    return ", ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items())


def met(*shares: dict[str, float]) -> bool:
    """Whether the 95 % level is exceeded by 3 to 7 % in every class."""
    return all(0.03 <= share <= 0.07 for some in shares for share in some.values())
