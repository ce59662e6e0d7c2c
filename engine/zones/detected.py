"""What a change detected in each cell, of which zones are made, and what is written with them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date

from numpy import bool_, floating, integer
from numpy.typing import NDArray


@dataclass(frozen=True)
class Detected:
    """Judgement of the cells; arrays (rows, columns).

    Attributes:
        significant: cells beyond their level of detection.
        level: level of detection of each cell at 95 % confidence, metres.
        count_min: points of each cell in the epoch that has fewer.
        stable: cells that are taken as stable ground, on which the errors' correlation is measured; without it, those
            outside of every footprint.
        heights: heights of the surface, metres, for the zones' inclination.
    """

    significant: NDArray[bool_]
    level: NDArray[floating]
    count_min: NDArray[integer]
    stable: NDArray[bool_] | None = None
    heights: NDArray[floating] | None = None


@dataclass(frozen=True)
class Origin:
    """Where zones come from: dates of both surveys, method and run."""

    epochs: tuple[date | None, date | None] = (None, None)
    method: str = ""
    run_id: str = ""
