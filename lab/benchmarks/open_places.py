"""How far two surveys lie apart in height where nothing grows: the truth of a registration, without any classes.

A vendor's ground does not tell it. Of two strips it takes the lower one's returns more often, which hides an offset.
"""

from __future__ import annotations

import math

import numpy as np

from ...engine.core.arrays import Bool, Float
from ...engine.ground.squares import square_numbers

SIDE = 2.0
MIN_RETURNS = 6
"""Of each survey in a square: a plane and an offset have four unknowns."""
MAX_OFF, SHARE = 0.12, 0.97
"""A square is open if this share of both surveys' returns lies so near (m) to one plane and its offset."""
MAX_GRADE = 1.2
MIN_PLACES = 8


def offset_of_open_places(first: Float, second: Float) -> tuple[float, float, int]:
    """Mean height of all returns ``second`` (m, 3) over ``first`` (n, 3), its standard error, m, and how many places.

    NaN with fewer than ``MIN_PLACES`` open squares.
    """
    xyz = np.vstack([first, second])
    later = np.arange(len(xyz)) >= len(first)
    number = square_numbers(xyz, SIDE)
    order = np.argsort(number, kind="stable")
    offsets = []
    for inside in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
        returns = np.count_nonzero(later[inside])
        if min(returns, len(inside) - returns) >= MIN_RETURNS:
            offsets.append(_offset(xyz[inside], later[inside]))
    found = np.array(offsets)[np.isfinite(offsets)] if offsets else np.zeros(0)
    if found.size < MIN_PLACES:
        return math.nan, math.nan, found.size
    return float(found.mean()), float(found.std(ddof=1) / math.sqrt(found.size)), found.size


def _offset(xyz: Float, later: Bool) -> float:
    """Of the later returns from the plane of all (n, 3); NaN if the square is not open."""
    off = xyz - xyz.mean(axis=0)
    terms = np.column_stack([off[:, :2], later, np.ones(len(off))])
    found = np.linalg.lstsq(terms, off[:, 2], rcond=None)[0]
    near = np.abs(off[:, 2] - terms @ found) < MAX_OFF
    return float(found[2]) if near.mean() >= SHARE and np.hypot(*found[:2]) < MAX_GRADE else math.nan
