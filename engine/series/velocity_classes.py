"""Velocity classes of landslides (Cruden and Varnes 1996, Landslides: investigation and mitigation, table 3-4)."""

from __future__ import annotations

# Upper limit of each class, millimetres a day. A month is the twelfth of a year of 365.25 days.
_YEAR_DAYS = 365.25
CLASSES: tuple[tuple[float, str], ...] = (
    (16.0 / _YEAR_DAYS, "extremely slow"),  # 16 mm a year
    (1600.0 / _YEAR_DAYS, "very slow"),  # 1.6 m a year
    (13_000.0 * 12 / _YEAR_DAYS, "slow"),  # 13 m a month
    (1800.0 * 24, "moderate"),  # 1.8 m an hour
    (3000.0 * 1440, "rapid"),  # 3 m a minute
    (5000.0 * 86_400, "very rapid"),  # 5 m a second
)


def velocity_class(mm_day: float) -> str:
    """Class of a velocity, whatever its sign."""
    return next((name for limit, name in CLASSES if abs(mm_day) < limit), "extremely rapid")
