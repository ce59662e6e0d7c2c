"""How many digits a figure has: its error has two, and the figure ends at the same place."""

from __future__ import annotations

import math

_MAX_DECIMALS = 6  # what is smaller has no meaning in metres, m² or m³


def digits_of_error(error: float) -> int:
    """Decimals with which an error above zero has two significant digits; negative for tens, six at most."""
    place = 1 - math.floor(math.log10(error))
    if round(error, place) >= 10.0 ** (2 - place):  # 0.0996 is 0.10
        place -= 1
    return min(place, _MAX_DECIMALS)


def significant_decimals(value: float, digits: int = 2) -> int:
    """Decimals, none at least, of a figure with so many significant digits; for figures without an error."""
    if not math.isfinite(value) or not value:
        return 0
    return min(max(digits - 1 - math.floor(math.log10(abs(value))), 0), _MAX_DECIMALS)
