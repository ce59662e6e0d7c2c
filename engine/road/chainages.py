"""Chainages as numbers and as text: K12+345, 12.345 km, stations of 100 feet."""

from __future__ import annotations

import math
import re

METRES_OF = {"m": 1.0, "km": 1000.0, "ft": 0.3048, "us_ft": 1200.0 / 3937.0}
"""Metres of one unit of a chainage, by the unit's name."""
STYLES = ("K12+345", "12+345", "km", "m", "stations")
"""How chainages are written; stations are of 100 feet, as in 123+45."""
_PLUS = re.compile(r"^\s*[A-Za-z]{0,4}\s*(-?)(\d+)\s*\+\s*(\d+(?:\.\d+)?)\s*$")
_FEET_A_STATION = 100.0


def as_text(metres: float, style: str = STYLES[0], unit: str = "m") -> str:
    """A chainage of so many metres as people write it, to the metre (foot).

    Args:
        style: one of ``STYLES``.
        unit: of the agency's chainages, which says what a foot is.
    """
    if style == "km":
        return f"{metres / 1000:.3f} km"
    if style == "m":
        return f"{metres:.0f} m"
    stations = style == "stations"
    whole = round(metres / METRES_OF[unit if unit in ("ft", "us_ft") else "ft"]) if stations else round(metres)
    large, small = divmod(abs(whole), 100 if stations else 1000)
    sign = "-" if whole < 0 else ""
    return f"{'K' if style.startswith('K') else ''}{sign}{large}+{small:0{2 if stations else 3}d}"


def range_text(begin: float, end: float, style: str = STYLES[0], unit: str = "m") -> str:
    """From one chainage to another; one of them where they read alike."""
    first, last = as_text(begin, style, unit), as_text(end, style, unit)
    return first if first == last else f"{first} to {last}"


def chainage_of(value: object, unit: str) -> float | None:
    """Metres of a field's chainage: a number in ``unit``, or a text such as K12+345; None for an empty one.

    A text with a plus is kilometres and metres, or stations of 100 feet where the unit is a foot.

    Raises:
        ValueError: it is neither.
    """
    if value is None or value != value or (isinstance(value, str) and not value.strip()):
        return None
    if isinstance(value, str) and (match := _PLUS.match(value)):
        feet = unit in ("ft", "us_ft")
        large, small = float(match[2]), float(match[3])
        found = large * (_FEET_A_STATION if feet else 1000.0) + small
        return (-found if match[1] else found) * (METRES_OF[unit] if feet else 1.0)
    number = float(value)  # type: ignore[arg-type]
    if not math.isfinite(number):
        raise ValueError(f"{value} is no chainage")
    return number * METRES_OF[unit]
