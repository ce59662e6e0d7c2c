"""The unit that rates of movement are shown in: mm a month, or mm a year where all of them are slow."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

DAYS_A_MONTH, DAYS_A_YEAR = 365.25 / 12, 365.25
RULE = "Rates are in mm/month if the fastest of them is at least 1 mm/month, else in mm/year."


@dataclass(frozen=True)
class RateUnit:
    """``name`` of the unit, and the ``days`` by which a rate in mm a day is multiplied."""

    name: str
    days: float


def rate_unit(rates_mm_day: Iterable[Any]) -> RateUnit:
    """One unit for all rates that are shown together (see ``RULE``); what is no number does not count."""
    known = (abs(r) for r in rates_mm_day if isinstance(r, (int, float)) and math.isfinite(r))
    if max(known, default=0.0) * DAYS_A_MONTH >= 1.0:
        return RateUnit("mm/month", DAYS_A_MONTH)
    return RateUnit("mm/year", DAYS_A_YEAR)
