"""Numbers as text for people and tables: a zero has no sign, and an error is never rounded to nothing."""

from __future__ import annotations

import math

_MAX_DECIMALS = 6  # decimals: what is smaller has no meaning in metres, m² or m³


def fixed(value: float, digits: int, *, sign: bool = False, grouped: bool = False) -> str:
    """``value`` with ``digits`` decimals; what rounds to zero is written without a sign.

    Args:
        sign: also write the plus of a positive number.
        grouped: thousands are set apart by commas.
    """
    text = f"{value:,.{digits}f}" if grouped else f"{value:.{digits}f}"
    if not any(c in "123456789" for c in text):
        return text.removeprefix("-")
    return f"+{text}" if sign and not text.startswith("-") else text


def digits_for_error(error: float, least: int) -> int:
    """``least`` decimals, or as many more as a standard error needs not to be rounded to zero; six at most."""
    if not math.isfinite(error) or error <= 0 or round(error, least) > 0:
        return least
    return min(-math.floor(math.log10(error)), max(least, _MAX_DECIMALS))
