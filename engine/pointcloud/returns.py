"""Which points are the last return of their pulse, where the cloud's return numbers can be believed."""

from __future__ import annotations

from dataclasses import dataclass, replace

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


@dataclass(frozen=True)
class ReturnCounts:
    """Numbers of points: all, without a return number or a number of returns, without both, first and last returns."""

    points: int = 0
    unnumbered: int = 0
    bare: int = 0
    firsts: int = 0
    lasts: int = 0

    def with_more(self, number: NDArray[np.integer], total: NDArray[np.integer]) -> ReturnCounts:
        """These and points with return numbers (n,) and numbers of returns (n,)."""
        return ReturnCounts(
            self.points + len(number),
            self.unnumbered + int(np.count_nonzero((number == 0) | (total == 0))),
            self.bare + int(np.count_nonzero((number == 0) & (total == 0))),
            self.firsts + int(np.count_nonzero(number == 1)),
            self.lasts + int(np.count_nonzero(are_last(number, total))),
        )


def are_last(number: NDArray[np.integer], total: NDArray[np.integer]) -> NDArray[np.bool_]:
    """(n,) which points are last or only returns, by their return numbers and numbers of returns (n,)."""
    return np.asarray((total == 1) | (number == total), dtype=np.bool_)


def last_returns(number: NDArray[np.integer], total: NDArray[np.integer]) -> Returns:
    """Judge return numbers (n,) and numbers of returns (n,)."""
    found = returns_of(ReturnCounts().with_more(number, total))
    return replace(found, last=are_last(number, total) if found.usable else np.ones(len(number), dtype=bool))


def returns_of(counts: ReturnCounts) -> Returns:
    """Judge the return numbers of points of which only the counts are known; ``last`` stays empty."""
    nothing = np.zeros(0, dtype=bool)
    if counts.unnumbered == counts.points:
        return Returns(nothing, False, counts.bare < counts.points, "no return numbers")
    if counts.unnumbered:
        return Returns(nothing, False, True, f"{counts.unnumbered} points without a return number")
    # every pulse has one first and one last return, unless somebody took them out
    lost = max(0.0, 1.0 - counts.lasts / max(counts.firsts, 1))
    if counts.lasts < _MIN_LAST_RATIO * counts.firsts:
        return Returns(nothing, False, False, f"{counts.lasts} last returns for {counts.firsts} first ones", lost)
    return Returns(nothing, True, False, lost=lost)
