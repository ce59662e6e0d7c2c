"""Which points are the last return of their pulse, where the cloud's return numbers can be believed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MIN_LAST_RATIO = 0.8


@dataclass(frozen=True)
class Returns:
    """``last`` (n,) bool: last or only returns; all True where the numbers make no sense, ``note`` says why.

    ``usable`` says whether a choice by return number makes sense; ``mixed`` that some numbers but not all are 0,
    which PDAL refuses. ``lost`` is the share of the pulses whose last return is missing, 0 where it is not known.
    """

    last: NDArray[np.bool_]
    usable: bool
    mixed: bool
    note: str = ""
    lost: float = 0.0


def last_returns(number: NDArray[np.integer], total: NDArray[np.integer]) -> Returns:
    """Judge return numbers (n,) and numbers of returns (n,)."""
    everything = np.ones(len(number), dtype=bool)
    zero = (number == 0) | (total == 0)
    if zero.all():
        return Returns(everything, False, bool(((number != 0) | (total != 0)).any()), "no return numbers")
    if zero.any():
        return Returns(everything, False, True, f"{int(zero.sum())} points without a return number")
    last = (total == 1) | (number == total)
    firsts, lasts = int(np.count_nonzero(number == 1)), int(np.count_nonzero(last))
    # every pulse has one first and one last return, unless somebody took them out
    lost = max(0.0, 1.0 - lasts / max(firsts, 1))
    if lasts < _MIN_LAST_RATIO * firsts:
        return Returns(everything, False, False, f"{lasts} last returns for {firsts} first ones", lost)
    return Returns(last, True, False, lost=lost)
