"""Numbers as text for people and tables: a zero has no sign."""

from __future__ import annotations


def fixed(value: float, digits: int, *, sign: bool = False, grouped: bool = False) -> str:
    """``value`` with ``digits`` decimals (negative: rounded to tens and so on); what rounds to zero has no sign.

    Args:
        sign: also write the plus of a positive number.
        grouped: thousands are set apart by commas.
    """
    if digits < 0:
        value, digits = round(value, digits), 0
    text = f"{value:,.{digits}f}" if grouped else f"{value:.{digits}f}"
    if not any(c in "123456789" for c in text):
        return text.removeprefix("-")
    return f"+{text}" if sign and not text.startswith("-") else text
