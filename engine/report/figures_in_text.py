"""Figures as text of the report to sign, as the tables of zones hold them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ...interface.language import current_language, translator
from ...interface.rounding import digits_of_error, significant_decimals
from .figures import LEAST_ERROR, number

NOT_KNOWN = "–"


def say(text: str) -> str:
    """``text`` in the language of the report."""
    return translator(current_language())(text)


def value_of(row: Mapping[str, Any], name: str) -> float | None:
    """A number of a table's row; None where it is not known."""
    value = row.get(name)
    known = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if known and value is not None else None


def words_of(row: Mapping[str, Any], name: str) -> str:
    """A text of a table's row; empty where there is none."""
    value = row.get(name)
    return value.strip() if isinstance(value, str) else ""


def figure(
    row: Mapping[str, Any], name: str, unit: str = "", digits: int = 3, *, sign: bool = False, scale: float = 1.0
) -> str:
    """A number with its unit; a dash where it is not known."""
    value = value_of(row, name)
    if value is None:
        return NOT_KNOWN
    text = number(value * scale, digits, sign=sign)
    return f"{text}\u00a0{say(unit)}" if unit else text


def with_error(
    row: Mapping[str, Any],
    name: str,
    error: str,
    unit: str = "",
    digits: int = 2,
    *,
    sign: bool = True,
    scale: float = 1.0,
) -> str:
    """A number with its standard error, whose two significant digits say where both end; without an error ``digits``
    decimals.
    """
    uncertain = value_of(row, error)
    if uncertain is None or uncertain * scale <= LEAST_ERROR or value_of(row, name) is None:
        return figure(row, name, unit, digits, sign=sign, scale=scale)
    digits = digits_of_error(uncertain * scale)
    value = figure(row, name, digits=digits, sign=sign, scale=scale)
    return f"{value}\u00a0±\u00a0{figure(row, error, unit, digits, scale=scale)}"


def significant(row: Mapping[str, Any], name: str, unit: str = "") -> str:
    """A number without an error: two significant digits, more only before the point."""
    return figure(row, name, unit, significant_decimals(value_of(row, name) or 0.0))


def interval(row: Mapping[str, Any], low: str, high: str, unit: str = "", digits: int = 2, *, sign: bool = True) -> str:
    """Two numbers as the ends of an interval; a dash where one is not known."""
    if value_of(row, low) is None or value_of(row, high) is None:
        return NOT_KNOWN
    return say("{0} to {1}").format(
        figure(row, low, digits=digits, sign=sign), figure(row, high, unit, digits, sign=sign)
    )


def percent(row: Mapping[str, Any], name: str, digits: int = 0) -> str:
    """A share as a percentage."""
    return figure(row, name, "%", digits, scale=100.0)
